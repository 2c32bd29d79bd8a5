"""[pad.contact] smoothing_ms: a filter of the pose, for fingers that move slowly and numbers with little noise.

It is an α-β-γ filter: least squares with fading memory, through the pose, its speed and its acceleration (Morrison,
"Introduction to sequential smoothing and prediction", 1969). It follows a finger that moves at constant speed without
lag, although the magnet below it sinks and rises in a curve. If the pose jumps by more than noise explains, the filter
starts again from it, so a press is not seen later. Deviations remain those of a single frame: the filter does not know
which part of them is the same in every frame (gains, places, ambient field), and they must not become too small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.arithmetic.elementary import exp, power, square
from fmfts.arithmetic.matrix import least_squares, length, product
from fmfts.common.chi2 import quantile
from fmfts.pad import Array

COMPONENTS = 5  # position, and the two independent components of the axis
JUMP_PROBABILITY = 1e-3


@dataclass(slots=True)
class SmootherMemory:
    """pose (6,): position and axis, None before the first frame. speed, acceleration (6,): per s and s²."""

    pose: Array | None
    speed: Array
    acceleration: Array


class Smoother:
    """Smooths the poses of one pad. memory_s: time in which a frame's weight falls to 1/e; zero: no smoothing."""

    def __init__(self, memory_s: float) -> None:
        self._memory_s = memory_s
        self._jump_chi2 = quantile(JUMP_PROBABILITY, COMPONENTS)
        self.memory = SmootherMemory(None, np.zeros(6), np.zeros(6))

    def update(self, position_m: Array, axis: Array, covariance: Array, elapsed_s: float) -> tuple[Array, Array, Array]:
        """Smooth a pose, `elapsed_s` after the one before. Returns position (3,), axis (3,), covariance (6, 6)."""
        if self._memory_s == 0.0:
            return position_m, axis, covariance
        memory, pose = self.memory, np.concatenate([position_m, axis])
        fading = exp(-elapsed_s / self._memory_s)
        predicted = None
        if memory.pose is not None:
            predicted = memory.pose + (memory.speed + memory.acceleration * elapsed_s / 2.0) * elapsed_s
        if predicted is None or elapsed_s <= 0.0 or self._jumped(pose - predicted, covariance):
            memory.pose, memory.speed, memory.acceleration = pose, np.zeros(6), np.zeros(6)
            return position_m, axis, covariance
        innovation, fresh = pose - predicted, 1.0 - fading
        smoothed = predicted + (1.0 - power(fading, 3)) * innovation
        memory.speed += memory.acceleration * elapsed_s + 1.5 * square(fresh) * (1.0 + fading) / elapsed_s * innovation
        memory.acceleration += power(fresh, 3) / square(elapsed_s) * innovation
        memory.pose = np.concatenate([smoothed[:3], smoothed[3:] / length(smoothed[3:])])
        return memory.pose[:3], memory.pose[3:], covariance

    def _jumped(self, innovation: Array, covariance: Array) -> bool:
        """Whether noise does not explain the innovation. Its variance is less than twice that of the pose."""
        moved = innovation[:COMPONENTS]
        expected = 2.0 * covariance[:COMPONENTS, :COMPONENTS]
        chi2 = product(moved, least_squares(expected, moved))
        return not chi2 <= self._jump_chi2
