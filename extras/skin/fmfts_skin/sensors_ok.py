"""Which sensors a message's estimate was solved from: its `sensors_ok`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


def mask_of(used: NDArray[np.bool_]) -> int:
    """Bit i is set if every axis of sensor i is used. used: (N, 3)."""
    return _mask_of(used.tobytes(), used.shape)


@lru_cache(maxsize=256)
def _mask_of(used: bytes, shape: tuple[int, ...]) -> int:
    """The mask by the bytes of `used`, which are mostly those of the frame before."""
    whole = np.frombuffer(used, dtype=np.bool_).reshape(shape).all(axis=1)
    return sum(1 << sensor for sensor in np.flatnonzero(whole).tolist())
