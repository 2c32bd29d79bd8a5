"""Cubic B-splines on evenly spaced knots, and powers of a load, for arrays; spline.h has the equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic import _arithmetic

Array = NDArray[np.float64]


class Splines(NamedTuple):
    """The four splines that cover each of K places: the first one's index (K,), their values and slopes (K, 4)."""

    cell: NDArray[np.int64]
    value: Array
    slope: Array

    @property
    def indices(self) -> NDArray[np.int64]:
        """(K, 4)."""
        return self.cell[:, None] + np.arange(4)


def cover(at: Array, first: float, spacing: float, cells: int) -> Splines:
    """The splines at places (K,), on cells + 1 knots. A place beyond the knots counts as on the last one."""
    at = np.ascontiguousarray(at, dtype=float)
    splines = Splines(np.empty(len(at), np.int64), np.empty((len(at), 4)), np.empty((len(at), 4)))
    _arithmetic.cover(first, spacing, cells, at, *splines)
    return splines


def powers(x: Array, most: float, count: int) -> Array:
    """(K, count) x, x² …; above `most` they follow their tangents."""
    x = np.ascontiguousarray(x, dtype=float)
    value = np.empty((len(x), count))
    _arithmetic.powers(most, count, x, value)
    return value


def spline_collocation(count: int) -> Array:
    """Matrix (count+2, count+2): B-spline coefficients → values at the knots, not-a-knot conditions at both ends."""
    matrix = np.zeros((count + 2, count + 2))
    for knot in range(count):
        matrix[knot + 1, knot : knot + 3] = 1 / 6, 4 / 6, 1 / 6
    matrix[0, :5] = matrix[-1, -5:] = 1, -4, 6, -4, 1
    return matrix
