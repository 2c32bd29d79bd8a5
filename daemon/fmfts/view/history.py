"""The last ten seconds of a number, drawn as a row of blocks."""

from __future__ import annotations

import math
from collections import deque

BINS = 20
BIN_NS = 500_000_000
BLOCKS = " ▁▂▃▄▅▆▇█"


class History:
    """The largest value of each half second; unknown ones leave a gap."""

    def __init__(self) -> None:
        self._bins: deque[float | None] = deque([None] * BINS, maxlen=BINS)
        self._bin = 0

    def add(self, time_ns: int, value: float | None) -> None:
        number = time_ns // BIN_NS
        for _ in range(min(max(number - self._bin, 0), BINS)):
            self._bins.append(None)
        self._bin = max(number, self._bin)
        last = self._bins[-1]
        if value is not None:
            self._bins[-1] = value if last is None else max(last, value)

    @property
    def largest(self) -> float:
        return max((value for value in self._bins if value is not None), default=0.0)

    def blocks(self, columns: int = BINS) -> str:
        """The newest bins, relative to the largest value; "·" where nothing is known."""
        largest = self.largest
        shown = list(self._bins)[-columns:]
        return "".join("·" if value is None else BLOCKS[_level(value, largest)] for value in shown)


def _level(value: float, largest: float) -> int:
    return 0 if largest <= 0.0 or value <= 0.0 else math.ceil(value / largest * (len(BLOCKS) - 1))
