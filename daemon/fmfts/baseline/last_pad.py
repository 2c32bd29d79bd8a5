"""The interface to higher rooms that a request to record a replaced pad needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from fmfts.baseline.baseline import Baseline
from fmfts.sensor import Frame


class LastPad(Protocol):
    """What was known of the pad before it was replaced (pipeline.last_pad)."""

    @property
    def unweighed(self) -> float:
        """Deviation of the logarithm of its scale of forces, before anything was weighed."""

    def pressed_n(self, frames: Sequence[Frame], before: Baseline) -> float | None:
        """The force that these frames mean with its baseline `before`; None: no touch, or not known."""
