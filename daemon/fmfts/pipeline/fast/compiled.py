"""The compiled module, if it could be built, and whether to use it."""

from __future__ import annotations

import os

try:
    from fmfts.pipeline.fast import _fast as _fast
except ImportError:  # no compiler was there when the package was built
    _fast = None  # type: ignore[assignment]

__all__ = ["AVAILABLE", "NUMBERS", "_fast"]

# FMFTS_SOLVER=numpy turns off all compiled code, for comparisons.
AVAILABLE = _fast is not None and os.environ.get("FMFTS_SOLVER") != "numpy"
NUMBERS: dict[str, int] = _fast.NUMBERS if AVAILABLE else {}
