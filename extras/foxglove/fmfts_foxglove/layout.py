"""Where the layout is that `fmfts-daemon layout foxglove` prints."""

from __future__ import annotations

from pathlib import Path

LAYOUT = Path(__file__).with_name("layout.json")
