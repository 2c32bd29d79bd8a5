"""The compiled module, if it could be built, whether to use it, and what goes to it."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

try:
    from fmfts.several import _several as _several
except ImportError:  # no compiler was there when the package was built
    _several = None  # type: ignore[assignment]

__all__ = ["AVAILABLE", "MOST", "_several", "doubles", "finite", "padded", "room"]

Array = NDArray[np.float64]

# FMFTS_SOLVER=numpy turns off all compiled code, for comparisons.
AVAILABLE = _several is not None and os.environ.get("FMFTS_SOLVER") != "numpy"
# Of what there is room for; the NumPy reference takes more.
MOST: dict[str, int] = _several.MOST if AVAILABLE else {}


def room(**counts: int) -> bool:
    """Whether the compiled module is there, and has room for so many magnets, sensors, fingers …"""
    return AVAILABLE and all(count <= MOST[name] for name, count in counts.items())


def doubles(values: Array) -> Array:
    """As C reads them."""
    return np.ascontiguousarray(values, dtype=np.float64)


def padded(rows: Array) -> Array:
    """Rows (…, n), filled with zeros to as many doubles as C adds up at once."""
    missing = -rows.shape[-1] % _several.LANES
    return np.concatenate([rows, np.zeros((*rows.shape[:-1], missing))], axis=-1)


def finite(**arrays: Array) -> None:
    """ValueError that names the first array and its first number that is NaN or infinite."""
    for name, values in arrays.items():
        if not np.isfinite(values).all():
            number = int(np.flatnonzero(~np.isfinite(values))[0])
            raise ValueError(f"{name}: number {number} is {values.ravel()[number]}, and must be finite")
