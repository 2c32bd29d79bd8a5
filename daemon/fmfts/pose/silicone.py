"""What silicone adds to the uncertainty of a change of pose: it creeps under a load, and recovers slowly afterwards.

A spring would move the magnet by the same way whenever the same force acts. Silicone moves it further the longer the
load lasts, and lets it back as slowly. How much differs from pad to pad, so nothing is corrected: it is counted. The
change of pose, filtered with a time constant for each decade, tells how much each decade can have crept, and where to.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product, root_of_squares
from fmfts.pad import Silicone

Array = NDArray[np.float64]

# One for each decade after the second in which a calibration measures ([collect] settle_s, average_s).
TIMES_S = np.array([1.0, 10.0, 100.0, 1000.0])
# Deviation of each decade's creep, in the creep that is configured. Decades count as independent, but all creep the
# same way; so the deviation of a long hold is six tenths of what it creeps by.
DECADE_DEVIATION = 1.25


@dataclass(slots=True)
class SiliconeMemory:
    """crept (4, 5): the change of pose, filtered with TIMES_S. pressed (5,): the last change, `unseen_s` ago."""

    crept: Array = field(default_factory=lambda: np.zeros((len(TIMES_S), 5)))
    pressed: Array = field(default_factory=lambda: np.zeros(5))
    unseen_s: float = 0.0


class SiliconeFollower:
    """Follows the loads of one pad."""

    def __init__(self, silicone: Silicone, longest_gap_s: float) -> None:
        """longest_gap_s: between two frames; after a longer one nobody knows what pressed meanwhile."""
        self.longest_gap_s = longest_gap_s
        self.share = float(root_of_squares(silicone.hysteresis, silicone.creep_per_decade))
        self.creep_share = DECADE_DEVIATION * silicone.creep_per_decade
        self.memory = SiliconeMemory()

    def passed(self, elapsed_s: float) -> None:
        """Note the time since the last frame; the pose of this one may stay unknown."""
        self.memory.unseen_s += elapsed_s

    def update(self, change: Array) -> Array:
        """The covariance (5, 5) to add to that of the change (5,) of pose from rest.

        The share of the change itself: hysteresis, and what creeps faster than a calibration measures. The rest: what
        earlier loads have left. After a gap, the load before or after it counts for all of it, whichever is larger.
        """
        memory = self.memory
        elapsed_s, memory.unseen_s = memory.unseen_s, 0.0
        was_larger = product(memory.pressed, memory.pressed) > product(change, change)
        held = memory.pressed if elapsed_s > self.longest_gap_s and was_larger else change
        memory.crept += (elapsed_s / (elapsed_s + TIMES_S))[:, None] * (held - memory.crept)
        memory.pressed = change
        return self.covariance(change)

    def covariance(self, change: Array) -> Array:
        """(5, 5) of a change of pose (5,) at the time of the last update."""
        return np.asarray(square(self.share) * np.outer(change, change) + self.left_behind(), dtype=np.float64)

    def left_behind(self) -> Array:
        """The covariance (5, 5) of what earlier loads have left of a change of pose."""
        left: Array = square(self.creep_share) * product(self.memory.crept.T, self.memory.crept)
        return left
