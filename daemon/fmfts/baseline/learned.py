"""The geometry that `baseline --learn` found, as the start of the estimate of a mounting.

It is no measurement: the stored presses are, and the drawing's tolerances stay the prior. It gives only the start of
the estimate, and the axes from which the chips' small rotations count.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.pad import Pad, SensorArray, rotation_from_vector
from fmfts.pose import State

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LearnedGeometry:
    """place_m (N, 3); rotation_rad (N, 3), rotation vectors against the drawing in the chips' own axes; pose (K, 6),
    position and axis of the magnet in each press."""

    place_m: Array
    rotation_rad: Array
    pose: Array

    def turned(self, pad: Pad) -> Pad:
        """The drawing with the learned rotations of the chips."""
        turns = np.array([rotation_from_vector(one) for one in self.rotation_rad])
        return replace(pad, sensors=SensorArray(pad.sensors.position_m, product(pad.sensors.axes, turns)))

    def from_drawing(self, known: Sensitivity) -> Sensitivity:
        """The same for the turned pad: the drawing's rotations, which are the prior's mean, are behind its own."""
        mean, count = known.mean.copy(), self.rotation_rad.size
        mean[count : 2 * count] -= self.rotation_rad.ravel()
        return Sensitivity(mean, known.covariance)

    def states(self, rest: State) -> tuple[State, ...]:
        return tuple(replace(rest, position_m=one[:3], axis=one[3:]) for one in self.pose)
