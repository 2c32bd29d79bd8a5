"""[pad.contact] smoothing_ms: a filter of the pose, for fingers that move slowly and numbers that are calm.

Least squares with a memory that fades, through a pose, its speed and acceleration (Morrison, "Introduction to
sequential smoothing and prediction", 1969; an α-β-γ filter): a finger that moves evenly is followed without lag, and so
is the magnet below it, which sinks and rises in a curve as the finger crosses the pad. A pose that jumps by more than
noise explains is believed at once, so a press is seen as early as without. Deviations stay those of a single frame: how
much of them is the same in every frame (gains, places, the ambient field) is not known here, and they must not be too
small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.arithmetic.elementary import exp, power, square
from fmfts.arithmetic.matrix import least_squares, length, product
from fmfts.common.chi2 import quantile
from fmfts.pad import Array

COMPONENTS = 5  # position, and the axis but for what follows from it
JUMP_PROBABILITY = 1e-3


@dataclass(slots=True)
class SmootherMemory:
    """pose (6,) position and axis, None before the first; speed and acceleration (6,) per s and s²."""

    pose: Array | None
    speed: Array
    acceleration: Array


class Smoother:
    """One pad's. memory_s: in which a frame's weight falls to 1/e; zero passes every pose on as it is."""

    def __init__(self, memory_s: float) -> None:
        self._memory_s = memory_s
        self._jump_chi2 = quantile(JUMP_PROBABILITY, COMPONENTS)
        self.memory = SmootherMemory(None, np.zeros(6), np.zeros(6))

    def update(self, position_m: Array, axis: Array, covariance: Array, elapsed_s: float) -> tuple[Array, Array, Array]:
        """A pose and its covariance (6, 6), `elapsed_s` after the one before, as smoothed."""
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
        """Noise of the prediction and of the pose: less than twice the pose's in variance."""
        moved = innovation[:COMPONENTS]
        expected = 2.0 * covariance[:COMPONENTS, :COMPONENTS]
        chi2 = product(moved, least_squares(expected, moved))
        return not chi2 <= self._jump_chi2
