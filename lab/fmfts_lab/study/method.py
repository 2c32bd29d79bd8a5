"""The interface of a method in a study: it gets the pad, and then one sample after another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from fmfts.pad import Array
from fmfts_lab.study.world import Sample, World


class Answer(NamedTuple):
    """position_m (3,), axis (3,), deviation_m (3,): of the position, None if the method gives none. flagged: the method
    itself rejects this answer, so its numbers do not count."""

    position_m: Array
    axis: Array
    deviation_m: Array | None
    flagged: bool


NOTHING = Answer(np.full(3, np.nan), np.full(3, np.nan), None, True)


class Method(Protocol):
    """Only `ask` is timed. `told` converts its result to an Answer."""

    def ask(self, sample: Sample) -> Any: ...

    def told(self, raw: Any) -> Answer: ...


# Makes a method for a world.
Maker = Callable[[World], Method]
