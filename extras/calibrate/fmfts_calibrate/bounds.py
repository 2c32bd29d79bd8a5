"""How well a press is known by the change of pose that it makes, for many presses at once."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import inverse, product
from fmfts.pad import Array


def answer_by_change(slope: Array, covariance: Array, shear_sd_n: Array | float = np.inf) -> Array:
    """Derivative (K, 2 + L, 5) of the most likely press by the change of pose. slope (K, 5, 2 + L): of the response.
    covariance (K, 5, 5): of the change. shear_sd_n (K,): prior deviation of each shear."""
    information = inverse(covariance)
    normal = _normal(slope, information)
    for shear in range(3, slope.shape[2]):
        normal[:, shear, shear] += 1.0 / square(shear_sd_n)
    answer: Array = product(inverse(normal), slope.transpose(0, 2, 1), information)
    return answer


def bound_of(slope: Array, covariance: Array) -> Array:
    """Cramér–Rao bound (K, 2 + L): the least deviations of a press whose change has `covariance` (K, 5, 5)."""
    bound: Array = np.sqrt(np.diagonal(inverse(_normal(slope, inverse(covariance))), axis1=1, axis2=2))
    return bound


def _normal(slope: Array, information: Array) -> Array:
    """Information (K, 2 + L, 2 + L) on the presses, plus a prior deviation of 1 m: at rest, the place is unknown."""
    normal: Array = product(slope.transpose(0, 2, 1), information, slope)
    return normal + 1e-6 * np.eye(normal.shape[1])
