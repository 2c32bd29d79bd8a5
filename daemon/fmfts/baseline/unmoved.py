"""Refuses a new zero under a load: the magnet must be where the last baseline found it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fmfts.arithmetic.matrix import length
from fmfts.baseline.recording import BaselineError, Recording
from fmfts.pad import Pad, Tolerance

if TYPE_CHECKING:
    from fmfts.baseline.baseline import Baseline


def require_unmoved(pad: Pad, tolerance: Tolerance, before: Baseline, recording: Recording) -> None:
    """BaselineError if the magnet, solved with the last baseline, has moved; the ambient field may have turned."""
    moved = before.any_mounting(pad).moved_since(pad, recording)
    if moved is not None and not length(moved) < tolerance.magnet_position_m:
        x, y, z = moved * 1e3
        raise BaselineError(
            f"the pad looks loaded: its magnet is ({x:+.2f}, {y:+.2f}, {z:+.2f}) mm away from where baseline "
            f"{before.id} found it (limit {tolerance.magnet_position_m * 1e3:.2f} mm): unload it. If nothing "
            "touches it, that baseline was recorded under load or with a bad chip: say --replaced, as for another pad"
        )
