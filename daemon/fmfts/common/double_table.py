"""Vectors of doubles whose parts have names: the tables of tables.h, which both languages read and write."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[np.float64] | NDArray[np.int64] | NDArray[np.uint8] | float


class Named:
    """`values` in the order of `layout` (name → how many); `named["gain"]` is a view of a part."""

    def __init__(self, layout: Mapping[str, int]) -> None:
        self.values = np.zeros(sum(layout.values()))
        self.buffer = self.values.data
        self._part: dict[str, Array] = {}
        first = 0
        for name, count in layout.items():
            self._part[name] = self.values[first : first + count]
            first += count

    def __contains__(self, name: str) -> bool:
        return name in self._part

    def __getitem__(self, name: str) -> Array:
        return self._part[name]

    def number(self, name: str) -> float:
        return float(self._part[name][0])

    def put(self, name: str, value: Numbers) -> None:
        """The first places of a part; ValueError where there are too few."""
        flat = np.ravel(np.asarray(value, dtype=np.float64))
        if len(flat) > len(self._part[name]):
            raise ValueError(f"{name}: {len(flat)} values, room for {len(self._part[name])}")
        self._part[name][: len(flat)] = flat
