"""The deviations of each finger, and of their sum, which the message's scalar fields hold."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.matrix import product
from fmfts.pad import Array
from fmfts.several.count import resultant
from fmfts.several.fit import Fit
from fmfts.several.reading import FingersReading


def deviation_of(reading: FingersReading, fit: Fit) -> Array:
    """(3,) of the resultant's place and force: at least what a valley of χ² leaves of them (several/valley.py)."""
    deviation = resultant_deviation(fit)
    if reading.least_variance is None:
        return deviation
    at_least: Array = np.maximum(deviation, np.sqrt(reading.least_variance[0]))
    return at_least


def deviation_of_each(reading: FingersReading, fit: Fit) -> Array:
    """(K, 3) of the place and force of each finger, as deviation_of."""
    if reading.least_variance is None:
        return fit.deviation
    at_least: Array = np.maximum(fit.deviation, np.sqrt(reading.least_variance[1:]))
    return at_least


def resultant_deviation(fit: Fit) -> Array:
    """(3,) of the resultant's place and force: with w the share of a finger, ∂x/∂x_k = w_k, ∂x/∂F_k = (x_k − x)/F."""
    if len(fit.fingers) == 1:
        alone: Array = fit.deviation[0]
        return alone
    middle_x, middle_y, whole = resultant(fit.fingers).tolist()
    force = max(whole, 1e-9)
    by_x: list[float] = []
    by_y: list[float] = []
    for x, y, part in fit.fingers.tolist():
        by_x += part / force, 0.0, (x - middle_x) / force
        by_y += 0.0, part / force, (y - middle_y) / force
    flat = np.array([by_x, by_y, [0.0, 0.0, 1.0] * len(fit.fingers)])
    variance = np.diagonal(product(flat, fit.covariance, flat.T))
    deviation: Array = np.sqrt(np.maximum(variance, 0.0))
    return deviation
