"""The joint positions that arrived while a baseline was recorded, and where the joints were at given times."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmfts.baseline.recording import BaselineError
from fmfts.common import possible
from fmfts.pad import Array

# Longest gap between positions that is interpolated.
APART_S = 0.25
NONE_CAME = (
    "no joint positions arrived while it was recorded: let a program publish them (docs/scene.md#a-hand-that-moves), "
    "then record it again"
)


class JointTrack:
    """Positions by joint, in order of time. Each source may send some of the joints, at its own rate."""

    def __init__(self) -> None:
        self._times: dict[str, list[int]] = {}
        self._positions: dict[str, list[float]] = {}

    def take(self, position_rad: Mapping[str, float], time_ns: int) -> None:
        """time_ns: on the host's clock. What is older than the newest is left out."""
        for name, position in position_rad.items():
            if name not in self._times and len(self._times) >= possible.MOST_JOINTS:
                continue
            times = self._times.setdefault(name, [])
            if not times or time_ns > times[-1]:
                times.append(time_ns)
                self._positions.setdefault(name, []).append(float(position))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(sorted(self._times))

    def at(self, time_ns: Array) -> Array:
        """(K, J) positions at times (K,) on the host's clock, NaN where they are not known."""
        positions = np.empty((len(time_ns), len(self.names)))
        for column, name in enumerate(self.names):
            positions[:, column] = self._at(name, time_ns)
        return positions

    def mean(self, names: tuple[str, ...], from_ns: int, to_ns: int) -> Array | None:
        """The mean positions (J,) of these joints while they stand still; None if one of them is unknown."""
        if not set(names) <= set(self.names):
            return None
        positions = self.at(np.linspace(float(from_ns), float(to_ns), 20))[:, [self.names.index(one) for one in names]]
        if np.isnan(positions).any():
            return None
        mean: Array = positions.mean(axis=0)
        return mean

    def _at(self, name: str, time_ns: Array) -> Array:
        times, positions = np.array(self._times[name], dtype=np.float64), np.array(self._positions[name])
        after = np.minimum(np.searchsorted(times, time_ns), len(times) - 1)
        before = np.maximum(after - 1, 0)
        span = np.maximum(times[after] - times[before], 1.0)
        share = np.clip((time_ns - times[before]) / span, 0.0, 1.0)
        found = positions[before] + share * (positions[after] - positions[before])
        nearest_ns = np.minimum(np.abs(time_ns - times[before]), np.abs(time_ns - times[after]))
        known: Array = np.where(nearest_ns <= APART_S * 1e9, found, np.nan)
        return known


def require_joints(track: JointTrack) -> None:
    """BaselineError if none arrived."""
    if not track.names:
        raise BaselineError(NONE_CAME)
