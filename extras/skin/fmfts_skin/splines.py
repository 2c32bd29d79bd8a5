"""The four cubic B-splines that cover a place between two knots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def cubic(share: Array) -> tuple[Array, Array]:
    """Values (K, 4) and slopes (K, 4), for knots that are 1 apart. share (K,): of the way from one knot to the next."""
    u, v = share, 1.0 - share
    values = (
        v * v * v / 6.0,
        (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0,
        (3.0 * v * v * v - 6.0 * v * v + 4.0) / 6.0,
        u * u * u / 6.0,
    )
    slopes = (-v * v, 3.0 * u * u - 4.0 * u, -(3.0 * v * v - 4.0 * v), u * u)
    return np.stack(values, axis=1), np.stack(slopes, axis=1) / 2.0
