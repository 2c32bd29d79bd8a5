"""What two fingers may be off where χ² is a long valley: a finger near the rim that is not well known.

There a finger further out that presses harder has nearly the same field, and χ² is no parabola: it rises at first, and
then stays. So each finger is put `AWAY` deviations to either side of where it was found, along the direction in which
it is known least; all else is fitted again; and if a finger or the resultant has moved there by d, where χ² has risen
by c, its deviation is d/√c at least. Along a parabola that is never more than the deviation that was told.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError, added, inverse, product, solve_lower
from fmfts.several.compiled import _several, doubles, room
from fmfts.several.field_model import FINGER
from fmfts.several.fit import FLOOR, Fit, Fitter
from fmfts.several.measured import Measured, refuse

Array = NDArray[np.float64]

AWAY, STEPS = 3.0, 2
LEAST_RISE = 1.0  # a smaller rise of χ² is not told from none
# A finger whose place is known better than this is in no such valley.
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
    if not (fitter.compiled and room(fingers=len(fit.fingers))):
        return reference_across(fitter, fit, away, directions, measured, around_t)
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


def reference_across(
    fitter: Fitter, fit: Fit, away: Array, directions: Array, measured: Measured, around_t: Array
) -> tuple[Array, Array]:
    """fitted_across() in NumPy."""
    root = fitter.whitener(fit.fingers, measured, around_t)
    there, chi2 = [], []
    for step, direction in zip(away, directions, strict=True):
        for side in SIDES:
            fingers, told = _on_the_table(fitter, fit.fingers.ravel() + side * step), np.inf
            try:
                for _ in range(STEPS):
                    fingers = _step_across(fitter, root, fingers, direction, measured)
                told = fitter.chi2_with(root, fingers, measured)
            except SingularError:
                pass  # it is not known there
            there.append(fingers)
            chi2.append(told)
    return np.array(there).reshape(len(away), len(SIDES), *fit.fingers.shape), np.array(chi2).reshape(len(away), -1)


def _step_across(fitter: Fitter, root: Array, fingers: Array, direction: Array, measured: Measured) -> Array:
    """One step of Gauss–Newton that leaves the fingers where they are along `direction`."""
    used, predicted = measured.used, fitter.model.predict(fingers)
    slope = solve_lower(root, predicted.slope[used])
    residual = solve_lower(root, (measured.field_t - predicted.field_t)[used])
    spread = inverse(product(slope.T, slope) + np.diag(np.tile(FLOOR, len(fingers))))
    step, along = product(spread, product(slope.T, residual)), product(spread, direction)
    across = product(direction, along)
    moved = fingers
    if across > 0.0:
        moved = _on_the_table(fitter, fingers.ravel() + (step - along * (product(direction, step) / across)))
    if not (across > 0.0 and np.isfinite(moved).all()):
        raise SingularError("a step across a valley leads nowhere")
    return moved


def _on_the_table(fitter: Fitter, fingers: Array) -> Array:
    response = fitter.model.response
    each = fingers.reshape(-1, FINGER)
    place = np.clip(each[:, :2], response.first_mm, response.last_mm)
    return np.column_stack([place, np.maximum(each[:, 2], LEAST_FORCE_N)])


def _whole_and_each(fingers: Array) -> Array:
    """(W, 1 + K, 3) the resultant, then the fingers (W, K, 3) themselves."""
    place, force = fingers[:, :, :2], fingers[:, :, 2:]
    each = range(fingers.shape[1])
    whole = added([force[:, number] for number in each])
    middle = added([place[:, number] * force[:, number] for number in each]) / np.maximum(whole, LEAST_FORCE_N)
    return np.concatenate([np.concatenate([middle, whole], axis=1)[:, None], fingers], axis=1)
