"""What a request to record a baseline asks of rooms above it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from fmfts.baseline.baseline import AnyMounting, Baseline
from fmfts.pad import Pad
from fmfts.sensor import Frame

LEARN_PRESSES = 60  # of which a geometry is learnt


class Learner(Protocol):
    """Learns what a recording of its own tells: a geometry (fmfts.learn), a silicone (pipeline.weighing), or what a
    hand's posture does to the field (posture.py).

    option: how a person asks for it. seconds: the usual time. presses: so many, all over the pad; 0: none.
    weight_n: a weight that stands on it; 0: none.
    """

    @property
    def option(self) -> str: ...
    @property
    def seconds(self) -> float: ...
    @property
    def presses(self) -> int: ...
    @property
    def weight_n(self) -> float: ...

    def require(self, pad: Pad, before: Baseline) -> None:
        """BaselineError, before anybody presses in vain."""

    def make(
        self, pad: Pad, frames: Sequence[Frame], before: Baseline | None
    ) -> tuple[Baseline, AnyMounting, dict[str, Any]]:
        """`before` with what was learned, its mounting, and facts. BaselineError if the presses do not tell it."""
