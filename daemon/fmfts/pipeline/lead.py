"""The age of a source's data when its message is published."""

from __future__ import annotations

from typing import NamedTuple


class Lead(NamedTuple):
    """frame_s: from when a board makes a frame to when its message is published. early_s: from when a chip has a sample
    that comes before its frame; 0: only frames are published."""

    frame_s: float = 0.0
    early_s: float = 0.0
