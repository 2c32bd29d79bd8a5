"""The controller of `clients/python/examples/grip.py`, and the same one without slip, for comparison."""

from __future__ import annotations

import importlib.util
import math
import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

EXAMPLE = Path(__file__).parents[2] / "python" / "examples" / "grip.py"
ASSUMED_FRICTION, SAFETY = 0.5, 1.5
FIXED_N = 1.7  # SAFETY times what the middle object needs
KINDS = ("slip", "shear", "fixed")


@cache
def example() -> ModuleType:
    """The example as a module. FileNotFoundError outside a checkout."""
    if not EXAMPLE.exists():
        raise FileNotFoundError(f"{EXAMPLE} is not there: run this in a checkout of fmfts, with pip install -e")
    spec = importlib.util.spec_from_file_location("fmfts_grip_example", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def controller(kind: str) -> Any:
    """slip: the example. shear: SAFETY times what the shear needs at ASSUMED_FRICTION. fixed: always FIXED_N."""
    grip = example()
    if kind == "slip":
        return grip.Grip()

    class Rival(grip.Grip):  # type: ignore[name-defined]
        def _wanted_n(self, seen: Any, force_n: float, loosen: bool, period_s: float) -> float:
            self.found = True
            if kind == "fixed":
                return FIXED_N
            shears_n = [math.hypot(each.shear_x_n or 0.0, each.shear_y_n or 0.0) for each in seen]
            before_n = self._shear_n.get("", max(shears_n))
            self._shear_n[""] = before_n + min(period_s / grip.SMOOTH_S, 1.0) * (max(shears_n) - before_n)
            return min(max(SAFETY * self._shear_n[""] / ASSUMED_FRICTION, grip.FIRST_N), grip.LARGEST_N)

    return Rival()
