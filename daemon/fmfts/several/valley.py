"""The error of fingers if χ² is a long valley: for an uncertain finger near the rim.

There a finger further out that presses harder has nearly the same field, and χ² is no parabola: it rises at first, and
then stays. So each finger is moved by `AWAY` deviations to either side, along its least certain direction, and all else
is fitted again. If a finger or the resultant then moved by d while χ² rose by c, its deviation is at least d/√c. Along
a parabola that never exceeds the published deviation. If χ² rose by less than `FLAT` of what a parabola rises, the
valley goes on: the finger is moved twice as far.

One finger that is found too weak and too far inside has too small deviations: further out, each newton and millimetre
changes the field less, and a harder press errs more by its shear and patch. It is moved to the harder side alone, and
c is of -2 log of the likelihood with the covariance that the field has there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.several import _several
from fmfts.several.fit import Fit, Fitter
from fmfts.several.measured import Measured, refuse

Array = NDArray[np.float64]

AWAY, STEPS = 3.0, 2
FLAT, FARTHEST = 0.7, 6.0  # no finger is moved farther than this many deviations
LEAST_RISE = 1.0  # a smaller rise of χ² counts as none
# A finger with a smaller deviation of its place is in no such valley.
UNSURE_MM = 0.3
LEAST_FORCE_N = 0.01
LIMITS = np.array([STEPS, LEAST_FORCE_N, AWAY, FARTHEST, FLAT, LEAST_RISE, UNSURE_MM])  # as fit.h has them


def valley_variance(fitter: Fitter, fit: Fit, measured: Measured, around_t: Array) -> Array | None:
    """(1 + K, 3) of the place (mm²) and force (N²), at least, of the resultant and of each finger.

    None where all fingers are well known.
    """
    least = np.empty((1 + len(fit.fingers), 3))
    given = fit.fingers, fit.covariance, np.array(fit.chi2), LIMITS, *measured.arrays, around_t
    wrong, size, ways = _several.valley(*fitter.model.parts, fitter.search, *given, least)
    refuse(wrong, size, measured, fingers=fit.fingers, covariance=fit.covariance, ambient_t=around_t)
    return least if ways else None
