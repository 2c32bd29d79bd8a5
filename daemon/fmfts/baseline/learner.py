"""The interface to higher rooms that a request to record a baseline needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from fmfts.baseline.baseline import AnyMounting, Baseline
from fmfts.pad import Pad
from fmfts.sensor import Frame

LEARN_PRESSES = 60  # presses from which a geometry is learned


class Learner(Protocol):
    """Learns from its own recording: a geometry (fmfts_calibrate.learn), a silicone (pipeline.weighing), or a
    hand's posture field (posture.py). option: its name on the command line.

     seconds: the usual time. presses: so many, all over the pad; 0: none.
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
        """`before` with the learned facts, and its mounting. BaselineError if the presses do not determine them."""
