"""Drops samples that newer ones of the same pad supersede, so that a late host catches up; and early samples that newer
ones of the same sensor, or a frame, supersede.

The bytes of everything else stay as they are.
"""

from __future__ import annotations

from fmfts.sensor.patience import Patience
from fmfts.sensor.wire import _wire

PADS = 3  # of a board, at most


def keep_newest(data: bytes, patience: Patience) -> tuple[bytes, tuple[int, ...]]:
    """`data` without the superseded samples, and how many frames of each pad (by pad index) were left out."""
    if data.count(0) < 2:
        return data, (0,) * PADS
    return _wire.keep_newest(data, *patience)
