"""How well the sum of all fingers is known, which is in the message's scalar fields, and each finger."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.matrix import product
from fmfts.pad import Array
from fmfts.several.count import resultant
from fmfts.several.field_model import FINGER
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
    whole, count = resultant(fit.fingers), len(fit.fingers)
    force = max(float(whole[2]), 1e-9)
    slope = np.zeros((FINGER, count, FINGER))
    for number, (x, y, part) in enumerate(fit.fingers.tolist()):
        slope[0, number] = part / force, 0.0, (x - whole[0]) / force
        slope[1, number] = 0.0, part / force, (y - whole[1]) / force
        slope[2, number, 2] = 1.0
    flat = slope.reshape(FINGER, -1)
    variance = np.diagonal(product(flat, fit.covariance, flat.T))
    deviation: Array = np.sqrt(np.maximum(variance, 0.0))
    return deviation
