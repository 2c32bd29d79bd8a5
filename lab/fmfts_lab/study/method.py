"""What a method is to a study: something that is told the pad, and asked for one sample after another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from fmfts.pad import Array
from fmfts_lab.study.world import Sample, World


class Answer(NamedTuple):
    """position_m (3,), axis (3,), deviation_m (3,): of the position, None where the method tells none. flagged: not to
    be believed, says the method itself; the numbers are then of no account."""

    position_m: Array
    axis: Array
    deviation_m: Array | None
    flagged: bool


NOTHING = Answer(np.full(3, np.nan), np.full(3, np.nan), None, True)


class Method(Protocol):
    """`ask` is what is timed; `told` makes of its result what it says of the pose."""

    def ask(self, sample: Sample) -> Any: ...

    def told(self, raw: Any) -> Answer: ...


# Makes a method for a world that a study has set up.
Maker = Callable[[World], Method]
