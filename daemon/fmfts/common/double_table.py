"""A vector of doubles with named parts, which Python and C both read and write; the C side declares the parts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[np.float64] | NDArray[np.int64] | NDArray[np.uint8] | float


class DoubleTable:
    """`values` holds the parts in the order of `layout` (name → number of doubles); `table["gain"]` views one part."""

    def __init__(self, layout: Mapping[str, int]) -> None:
        self.values = np.zeros(sum(layout.values()))
        self.buffer = self.values.data
        self.names = frozenset(layout)
        self._part: dict[str, Array] = {}
        first = 0
        for name, count in layout.items():
            self._part[name] = self.values[first : first + count]
            first += count

    def __getitem__(self, name: str) -> Array:
        return self._part[name]

    def number(self, name: str) -> float:
        """The first double of a part."""
        return float(self._part[name][0])

    def put(self, name: str, value: Numbers) -> None:
        """Writes `value` to the start of a part; raises ValueError where the part is too short."""
        if isinstance(value, float | int):
            self._part[name][0] = value
            return
        flat = np.ravel(np.asarray(value, dtype=np.float64))
        if len(flat) > len(self._part[name]):
            raise ValueError(f"{name}: {len(flat)} values, room for {len(self._part[name])}")
        self._part[name][: len(flat)] = flat
