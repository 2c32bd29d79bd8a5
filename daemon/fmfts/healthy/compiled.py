"""The compiled module where it could be built, and whether it is to be used."""

from __future__ import annotations

import os

try:
    from fmfts.healthy import _healthy
except ImportError:  # no compiler was there when the package was built
    _healthy = None  # type: ignore[assignment]

__all__ = ["AVAILABLE", "NUMBERS", "_healthy"]

# FMFTS_SOLVER=numpy leaves everything compiled aside, for comparisons.
AVAILABLE = _healthy is not None and os.environ.get("FMFTS_SOLVER") != "numpy"
NUMBERS: dict[str, int] = _healthy.NUMBERS if AVAILABLE else {}
