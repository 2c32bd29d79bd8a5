"""Keeps what happened lately to the pads, so that each chip can be asked for its own instants."""

from __future__ import annotations

import numpy as np
from fmfts.pad import Array


class History:
    """Values (M, …) at times (M,), between which it interpolates."""

    def __init__(self, *shape: int) -> None:
        self._time_s = np.empty(0)
        self._value = np.empty((0, *shape))

    def add(self, time_s: Array, value: Array) -> None:
        """Later values."""
        self._time_s = np.concatenate([self._time_s, time_s])
        self._value = np.concatenate([self._value, value])

    def forget(self, before_s: float) -> None:
        """Keep only values that are needed from this time on."""
        first = max(int(np.searchsorted(self._time_s, before_s, side="right")) - 1, 0)
        self._time_s, self._value = self._time_s[first:], self._value[first:]

    def at(self, time_s: Array, *index: np.ndarray) -> Array:
        """The value at each time; outside the stored times, the nearest one. index: into the value, as many."""
        if len(self._time_s) == 1:
            return np.asarray(self._value[(np.zeros(time_s.shape, dtype=int), *index)])
        before = np.clip(np.searchsorted(self._time_s, time_s, side="right") - 1, 0, len(self._time_s) - 2)
        first_s, next_s = self._time_s[before], self._time_s[before + 1]
        share = np.clip((time_s - first_s) / (next_s - first_s), 0.0, 1.0)
        earlier, later = self._value[(before, *index)], self._value[(before + 1, *index)]
        share = share.reshape(*share.shape, *(1,) * (earlier.ndim - share.ndim))
        return np.asarray(earlier + share * (later - earlier))
