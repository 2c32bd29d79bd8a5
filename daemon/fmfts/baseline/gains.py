"""What is known about the sensors' gains: their tolerance, or what turning the unloaded pad measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains per axis (measured = gain·true): mean (N, 3) and covariance (3N, 3N)."""

    mean: Array
    covariance: Array

    @classmethod
    def untested(cls, count: int, tolerance: float) -> Self:
        return cls(np.ones((count, 3)), np.eye(3 * count) * square(tolerance))


def relative_deviation(covariance: Array) -> Array:
    """(N, 3) deviation of gains with `covariance` (3N, 3N) from their mean: the moment absorbs a common factor."""
    size = len(covariance)
    apart = np.eye(size) - 1.0 / size
    deviation: Array = np.sqrt(np.diagonal(product(apart, covariance, apart))).reshape(-1, 3)
    return deviation
