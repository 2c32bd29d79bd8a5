"""What the resultant of two fingers may be off where χ² is a long valley: a finger near the rim that is not well known.

There a finger further out that presses harder has nearly the same field, and χ² is no parabola: it rises at first, and
then stays. So the finger that is known least is put `AWAY` deviations to either side of where it was found, along the
direction in which it is known least; all else is fitted again; and if the resultant has moved there by d, where χ² has
risen by c, its deviation is d/√c at least. Along a parabola that is never more than the deviation that was told.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError, eigen, inverse, product, solve_lower
from fmfts.several.count import resultant
from fmfts.several.field_model import FINGER
from fmfts.several.fit import FLOOR, Fit, Fitter
from fmfts.several.measured import Measured

Array = NDArray[np.float64]

AWAY, STEPS = 3.0, 2
LEAST_RISE = 1.0  # a smaller rise of χ² is not told from none
# A finger whose place is known better than this is in no such valley.
UNSURE_MM = 0.9
LEAST_FORCE_N = 0.01


def valley_variance(fitter: Fitter, fit: Fit, measured: Measured, around_t: Array) -> Array:
    """(3,) of the resultant's place (mm²) and force (N²), at least; zeros where both fingers are well known."""
    least, unsure, direction = np.zeros(3), 0.0, np.zeros(fit.fingers.size)
    variances = np.diagonal(fit.covariance).reshape(-1, FINGER)
    if (variances[:, 0] + variances[:, 1]).max() <= UNSURE_MM * UNSURE_MM:  # no direction has more than both axes
        return least
    for first in range(0, fit.fingers.size, FINGER):
        own = slice(first, first + 2)
        variance, axes = eigen(fit.covariance[own, own])
        weakest = int(np.argmax(variance))
        if variance[weakest] > unsure:
            unsure, direction = float(variance[weakest]), np.zeros(fit.fingers.size)
            direction[own] = axes[:, weakest]
    if unsure <= UNSURE_MM * UNSURE_MM:
        return least
    root, here = fitter.whitener(fit.fingers, measured, around_t), resultant(fit.fingers)
    away = product(fit.covariance, direction) * (AWAY / np.sqrt(unsure))
    for side in (1.0, -1.0):
        try:
            there = _fitted_across(fitter, root, fit.fingers.ravel() + side * away, direction, measured)
        except SingularError:
            continue
        rise = max(fitter.chi2_with(root, there, measured) - fit.chi2, LEAST_RISE)
        off = resultant(there) - here
        least = np.maximum(least, off * off / rise)
    return least


def _fitted_across(fitter: Fitter, root: Array, start: Array, direction: Array, measured: Measured) -> Array:
    """The most likely fingers (2, 3) near `start` that are as far along `direction`."""
    used, fingers = measured.used, _on_the_table(fitter, start)
    for _ in range(STEPS):
        predicted = fitter.model.predict(fingers)
        slope = solve_lower(root, predicted.slope[used])
        residual = solve_lower(root, (measured.field_t - predicted.field_t)[used])
        spread = inverse(product(slope.T, slope) + np.diag(np.tile(FLOOR, len(fingers))))
        step, along = product(spread, product(slope.T, residual)), product(spread, direction)
        step = step - along * (product(direction, step) / product(direction, along))
        fingers = _on_the_table(fitter, fingers.ravel() + step)
    return fingers


def _on_the_table(fitter: Fitter, fingers: Array) -> Array:
    response = fitter.model.response
    each = fingers.reshape(-1, FINGER)
    place = np.clip(each[:, :2], response.first_mm, response.last_mm)
    return np.column_stack([place, np.maximum(each[:, 2], LEAST_FORCE_N)])
