"""Lets the rest pose follow a slow drift of an unloaded pad (warming, ageing magnet, creeping silicone), within bounds.

A slow press looks like a drift. So the rest pose follows no faster and no further than the configuration allows: these
bounds keep a load from becoming the new zero. The tests for a quiet pad only exclude obvious loads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import length, product
from fmfts.pad import DriftLimits
from fmfts.pose.state import AXIS, POSITION, State, tangent_basis

Array = NDArray[np.float64]

# A tilt counts as the movement it makes at this distance: there tilt and position are equally uncertain (docs/pose.md).
LEVER_M = 4e-3
SCALE = np.array([1.0, 1.0, 1.0, LEVER_M, LEVER_M])
# A pose does not drift if it moves within a window by more than this many allowed rates, and deviations of its mean.
STEEPEST_RATES, STEEPEST_DEVIATIONS = 3.0, 5.0
CERTAIN_DEVIATIONS = 3.0
# Smaller steps make no new baseline; this is a tenth of the uncertainty of one window.
LEAST_STEP_M = 1e-7
FEWEST = 20
AT_LIMIT = 1.0 - 1e-9  # rounding may leave the drift this far below its limit


@dataclass(frozen=True, slots=True)
class Quiet:
    """One reading of an untouched pad."""

    time_s: float
    position_m: Array
    axis: Array
    force_n: float
    force_sd_n: float


class DriftFollower:
    """moved (5,): drift from the recorded rest pose, in m, and in rad in the tangent plane of its axis."""

    def __init__(self, rest: State, limits: DriftLimits) -> None:
        self.moved = np.zeros(5)
        self._rest = rest
        self._basis = tangent_basis(rest.axis)
        self._limits = limits
        self._window: list[tuple[float, Array, float]] = []

    @property
    def rest(self) -> State:
        """The rest pose with the drift learned so far."""
        step = np.zeros(6)
        step[POSITION], step[AXIS] = self.moved[POSITION], self.moved[AXIS]
        return self._rest.stepped(step)

    @property
    def size_m(self) -> float:
        return size_of(self.moved)

    def disturbed(self) -> None:
        """The pad is touched, or may be: start a new window."""
        self._window.clear()

    def saw(self, reading: Quiet) -> bool:
        """Take a reading. True if the rest pose has changed."""
        change = np.append(reading.position_m - self._rest.position_m, product(self._basis.T, reading.axis))
        bound_n = reading.force_n + CERTAIN_DEVIATIONS * reading.force_sd_n
        if self._window and not reading.time_s > self._window[-1][0]:
            self._window.clear()
        self._window.append((reading.time_s, change, bound_n))
        elapsed_s = reading.time_s - self._window[0][0]
        if elapsed_s < self._limits.quiet_s or len(self._window) < FEWEST:
            return False
        window, self._window = self._window, []
        return self._learnt(
            np.array([one for _, one, _ in window]), float(np.mean([one for *_, one in window])), elapsed_s
        )

    def _learnt(self, changes: Array, bound_n: float, elapsed_s: float) -> bool:
        half = len(changes) // 2
        travelled = size_of(changes[half:].mean(axis=0) - changes[:half].mean(axis=0))
        noise = size_of(changes.std(axis=0)) * np.sqrt(2.0 / half)
        allowed = self._limits.rate_m_per_s * elapsed_s
        steep = travelled > max(STEEPEST_RATES * allowed, STEEPEST_DEVIATIONS * noise)
        if steep or not bound_n < self._limits.force_below_n:
            return False
        step = _shortened(changes.mean(axis=0) - self.moved, allowed)
        moved = _shortened(self.moved + step, self._limits.limit_m)
        reaches_limit = self.size_m < AT_LIMIT * self._limits.limit_m <= size_of(moved)
        if size_of(moved - self.moved) < LEAST_STEP_M and not reaches_limit:
            return False
        self.moved = moved
        return True


def size_of(change: Array) -> float:
    """The length (m) of a change of pose (5,), its tilt as a movement."""
    return length(change * SCALE)


def _shortened(change: Array, limit_m: float) -> Array:
    size = size_of(change)
    return change if size <= limit_m else change * (limit_m / size)
