"""Imports the compiled module where it was built, and decides whether it is used."""

from __future__ import annotations

import os

try:
    from fmfts.arithmetic import _arithmetic
except ImportError:  # the package was built without a compiler
    _arithmetic = None  # type: ignore[assignment]

__all__ = ["AVAILABLE", "_arithmetic"]

# FMFTS_SOLVER=numpy switches all compiled code off, for comparisons.
AVAILABLE = _arithmetic is not None and os.environ.get("FMFTS_SOLVER") != "numpy"
