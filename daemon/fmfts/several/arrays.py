"""Arrays for the compiled part, and their limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.several._several import LANES, MOST

Array = NDArray[np.float64]


def require_room(**counts: int) -> None:
    """ValueError if a pad exceeds the limits of several.h for magnets, sensors, fingers …"""
    for name, count in counts.items():
        if count > MOST[name]:
            raise ValueError(f"a pad with several magnets may have {MOST[name]} {name}, and this one has {count}")


def doubles(values: Array) -> Array:
    """As C reads them."""
    return np.ascontiguousarray(values, dtype=np.float64)


def padded(rows: Array) -> Array:
    """Rows (…, n), filled with zeros to as many doubles as C adds up at once."""
    missing = -rows.shape[-1] % LANES
    return np.concatenate([rows, np.zeros((*rows.shape[:-1], missing))], axis=-1)


def finite(**arrays: Array) -> None:
    """ValueError that names the first array and its first number that is NaN or infinite."""
    for name, values in arrays.items():
        if not np.isfinite(values).all():
            number = int(np.flatnonzero(~np.isfinite(values))[0])
            raise ValueError(f"{name}: number {number} is {values.ravel()[number]}, and must be finite")
