"""The change of the magnets' field since the baseline, and its variance, from aligned samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import root_of_squares
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.pad import Pad
from fmfts.pose import Aligned
from fmfts.pose.neighbour import NeighbourEstimate, change_of
from fmfts.several.measured import Measured
from fmfts.several.recovery import Recovery

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class RestMemory(Protocol):
    """The part of an estimator's memory that is used here. ambient_t (3,): the change of the ambient field since the
    baseline. last_c: the last temperature that was told."""

    recovery: Recovery
    ambient_t: Array
    last_c: float | None


class Warmth(NamedTuple):
    """magnet_per_k: temperature coefficient of the remanence. rest_c: at the baseline, None if it is not known."""

    magnet_per_k: float
    rest_c: float | None


CONSTANT = Warmth(0.0, None)


class SinceRest:
    """Subtracts the baseline, at its temperature, and what neighbouring pads do to the field."""

    def __init__(self, pad: Pad, mounting: ArrayMounting, warmth: Warmth) -> None:
        self._mounting, self._warmth = mounting, warmth
        # By which share of its force the silicone may have crept.
        self.silicone = float(root_of_squares(pad.silicone.creep_per_decade, pad.silicone.hysteresis))
        # Of the last frame: the change of the field around, and the factor on the magnets' moments.
        self.around_t, self.moment = np.zeros(3), 1.0

    def measured(
        self,
        aligned: Aligned,
        temperature_c: float | None,
        there: Mask,
        neighbours: Sequence[NeighbourEstimate],
        memory: RestMemory,
        now_t: Array | float,
    ) -> Measured:
        """now_t (3N,): by how much presses change the field now, as far as it is known."""
        mounting, first_c = self._mounting, self._warmth.rest_c
        memory.last_c = memory.last_c if temperature_c is None else temperature_c
        warmer_k = 0.0 if first_c is None or memory.last_c is None else memory.last_c - first_c
        self.moment = 1.0 + self._warmth.magnet_per_k * warmer_k
        own, foreign_t2 = mounting.magnet_field(np.where(there, aligned.field_t, 0.0)), aligned.foreign_t2
        self.around_t = memory.ambient_t
        if neighbours:
            foreign_t, of_neighbours_t2 = change_of(mounting.sensors, neighbours)
            own = own - foreign_t
            foreign_t2 = of_neighbours_t2 if foreign_t2 is None else foreign_t2 + of_neighbours_t2
            # Rotated chips also misread the neighbours' field, which is about uniform over the pad.
            self.around_t = memory.ambient_t + mounting.sensors.to_pad(foreign_t).mean(axis=0)
        own = own / self.moment
        noise = mounting.noise_t * aligned.noise_share / mounting.gain
        bend = np.where(np.isfinite(aligned.bend_t), aligned.bend_t, 0.0)
        left_t = self.silicone * memory.recovery.beyond_t(now_t)
        variance_t2 = (square(noise) + square(bend)).ravel() + square(left_t)
        return Measured((own - mounting.rest_field_t).ravel(), variance_t2, there.ravel(), foreign_t2)
