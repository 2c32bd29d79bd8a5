"""Refuses a new zero that would be a load: the magnet must be where the last baseline found it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fmfts.arithmetic.matrix import length
from fmfts.baseline.array_mounting import ArrayMounting, moved_since
from fmfts.baseline.recording import BaselineError, Recording
from fmfts.baseline.skin_mounting import SkinMounting
from fmfts.pad import Pad, Tolerance
from fmfts.pose import FREE_FIELD, solve

if TYPE_CHECKING:
    from fmfts.baseline.baseline import Baseline


def require_unmoved(pad: Pad, tolerance: Tolerance, before: Baseline, recording: Recording) -> None:
    """BaselineError if the magnet, solved with the last baseline, has moved; the ambient field may have turned."""
    last = before.any_mounting(pad)
    if isinstance(last, SkinMounting):
        return  # a change of its field may be its temperature: nobody can tell
    if isinstance(last, ArrayMounting):
        moved, _ = moved_since(last, recording)
    else:
        estimate = solve(
            last.magnet_field(recording.mean_t),
            last.mounted(pad),
            last.rest,
            deviation_t=recording.mean_deviation_t,
            free=FREE_FIELD,
        )
        moved = estimate.position_m - last.rest.position_m
    if not length(moved) < tolerance.magnet_position_m:
        x, y, z = moved * 1e3
        raise BaselineError(
            f"the pad looks loaded: its magnet is ({x:+.2f}, {y:+.2f}, {z:+.2f}) mm away from where baseline "
            f"{before.id} found it (limit {tolerance.magnet_position_m * 1e3:.2f} mm): unload it. If nothing "
            "touches it, that baseline was recorded under load or with a bad chip: say --replaced, as for another pad"
        )
