"""The error of two fingers if χ² is a long valley: for an uncertain finger near the rim.

There a finger further out that presses harder has nearly the same field, and χ² is no parabola: it rises at first, and
then stays. So each finger is moved by `AWAY` deviations to either side, along its least certain direction, and all else
is fitted again. If a finger or the resultant then moved by d while χ² rose by c, its deviation is at least d/√c. Along
a parabola that never exceeds the published deviation.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import added, product
from fmfts.several import _several
from fmfts.several.arrays import doubles, require_room
from fmfts.several.field_model import FINGER
from fmfts.several.fit import Fit, Fitter
from fmfts.several.measured import Measured, refuse

Array = NDArray[np.float64]

AWAY, STEPS = 3.0, 2
LEAST_RISE = 1.0  # a smaller rise of χ² counts as none
# A finger with a smaller deviation of its place is in no such valley.
UNSURE_MM = 0.3
LEAST_FORCE_N = 0.01
LIMITS = np.array([STEPS, LEAST_FORCE_N])  # as fit.h has them
SIDES = (1.0, -1.0)


def valley_variance(fitter: Fitter, fit: Fit, measured: Measured, around_t: Array) -> Array | None:
    """(1 + K, 3) of the place (mm²) and force (N²), at least, of the resultant and of each finger.

    None where all fingers are well known.
    """
    away, directions = [], []
    for first in range(0, len(fit.covariance), FINGER):
        variance, direction = weakest(fit.covariance, first)
        if variance > UNSURE_MM * UNSURE_MM:
            away.append(product(fit.covariance, direction) * (AWAY / sqrt(variance)))
            directions.append(direction)
    if not away:
        return None
    there, chi2 = fitted_across(fitter, fit, np.array(away), np.array(directions), measured, around_t)
    told = _whole_and_each(np.concatenate([fit.fingers[None], there.reshape(-1, *fit.fingers.shape)]))
    off, rise = told[1:] - told[0], np.maximum(chi2.ravel() - fit.chi2, LEAST_RISE)
    least: Array = (off * off / rise[:, None, None]).max(axis=0)
    return least


def weakest(covariance: Array, first: int) -> tuple[float, Array]:
    """The largest variance (mm²) of a finger's place in any direction, and this direction (3K,).

    first: the number of the finger's x in the covariance.
    """
    (along_x, both), (_, along_y) = covariance[first : first + 2, first : first + 2].tolist()
    half = 0.5 * (along_x - along_y)
    root = sqrt(half * half + both * both)
    x, y = (half + root, both) if half >= 0.0 else (both, root - half)
    size = sqrt(x * x + y * y)
    direction = np.zeros(len(covariance))
    direction[first : first + 2] = (x / size, y / size) if size > 0.0 else (1.0, 0.0)
    return 0.5 * (along_x + along_y) + root, direction


def fitted_across(
    fitter: Fitter, fit: Fit, away: Array, directions: Array, measured: Measured, around_t: Array
) -> tuple[Array, Array]:
    """The most likely fingers (W, 2, K, 3) that are `away` along `directions`, both (W, 3K), to either side, and χ²
    (W, 2) of them under the covariance at `fit`; infinite where there are none."""
    require_room(fingers=len(fit.fingers))
    there, chi2 = np.empty((len(away), len(SIDES), *fit.fingers.shape)), np.empty((len(away), len(SIDES)))
    wrong, size, _ = _several.valley(
        fitter.model.packed,
        fitter.model.work,
        fitter.search,
        doubles(fit.fingers),
        doubles(away),
        doubles(directions),
        LIMITS,
        doubles(measured.field_t),
        doubles(measured.variance_t2),
        measured.foreign,
        measured.there,
        doubles(around_t),
        there,
        chi2,
    )
    refuse(wrong, size, measured, fingers=fit.fingers, away=away, directions=directions, ambient_t=around_t)
    return there, chi2


def _whole_and_each(fingers: Array) -> Array:
    """(W, 1 + K, 3) the resultant, then the fingers (W, K, 3) themselves."""
    place, force = fingers[:, :, :2], fingers[:, :, 2:]
    each = range(fingers.shape[1])
    whole = added([force[:, number] for number in each])
    middle = added([place[:, number] * force[:, number] for number in each]) / np.maximum(whole, LEAST_FORCE_N)
    return np.concatenate([np.concatenate([middle, whole], axis=1)[:, None], fingers], axis=1)
