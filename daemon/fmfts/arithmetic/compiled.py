"""The compiled part where it could be built, and whether it is to be used."""

from __future__ import annotations

import os

try:
    from fmfts.arithmetic import _arithmetic
except ImportError:  # no compiler was there when the package was built
    _arithmetic = None  # type: ignore[assignment]

__all__ = ["AVAILABLE", "_arithmetic"]

# FMFTS_SOLVER=numpy leaves everything compiled aside, for comparisons.
AVAILABLE = _arithmetic is not None and os.environ.get("FMFTS_SOLVER") != "numpy"
