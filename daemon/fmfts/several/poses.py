"""The poses of a pad's magnets, with their covariance.

The table of presses gives the poses that the fingers cause, but considered causes (shear, patch, the table's errors)
move the magnets, too. The residual determines these. With the fingers x ± Σ, the considered causes p ~ N(0, 1), the
poses A x + B p, and the field J x + P (B p) of covariance C (field_model.py), the most likely poses given the residual
r are

    A x + W r,  W = B B' P' C⁻¹,  with the covariance  B B' − W P B B' + (A − W J) Σ (A − W J)'
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.pose.magnets import CHANGE, Magnets
from fmfts.several import _several
from fmfts.several.fit import Fit, Fitter
from fmfts.several.measured import NOTHING, Measured, refuse

Array = NDArray[np.float64]

# Of each magnet, in m and components of the axis: from undetected fingers, and from silicone that has not recovered yet
# from a press.
UNFELT = np.array([1e-5, 1e-5, 2e-5, 2e-3, 2e-3])


class Poses(NamedTuple):
    """The magnets, and the change (5M,) of their poses since rest, in m and components of the axis. variance (M, 5):
    the diagonal of its covariance (5M, 5M), which is empty where it was not asked for."""

    magnets: Magnets
    change: Array
    variance: Array
    covariance: Array

    @classmethod
    def room(cls, rest: Magnets, with_covariance: bool = False) -> Poses:
        """For C to fill."""
        count, numbers = len(rest), CHANGE * len(rest)
        magnets = Magnets(np.empty((count, 3)), np.empty((count, 3)), rest.strength_t_m3, rest.octupole_m2)
        covariance = np.empty((numbers, numbers)) if with_covariance else NOTHING
        return cls(magnets, np.empty(numbers), np.empty((count, CHANGE)), covariance)

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All as C writes them, but for the covariance."""
        return self.change, self.magnets.position_m, self.magnets.axis, self.variance


def poses_of(fitter: Fitter, fit: Fit, measured: Measured, around_t: Array, with_covariance: bool = True) -> Poses:
    """The magnets of a frame, moved by the fingers and other causes.

    around_t (3,): the change of the field around, as `Fitter.fit` has it.
    """
    rest = fitter.model.mounting.magnets
    if not len(fit.fingers):  # at rest, with the uncertainty of undetected fingers
        variance = np.tile(square(UNFELT), (len(rest), 1))
        return Poses(rest, np.zeros(variance.size), variance, np.diag(variance.ravel()))
    found = Poses.room(rest, with_covariance)
    given = fit.fingers, fit.covariance, fit.misfit_t, *measured.arrays[1:], around_t
    wrong, size, _ = _several.poses(*fitter.model.parts, UNFELT, *given, *found.arrays, found.covariance)
    refuse(wrong, size, measured, fingers=fit.fingers, ambient_t=around_t)
    return found
