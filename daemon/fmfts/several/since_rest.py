"""The change of the magnets' field since the baseline, and its variance, from aligned samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.pad import Pad
from fmfts.pose import Aligned
from fmfts.pose.neighbour import NeighbourEstimate, change_of
from fmfts.several import _several
from fmfts.several.arrays import doubles
from fmfts.several.measured import Measured
from fmfts.several.recovery import RestMemory

Array = NDArray[np.float64]


class Warmth(NamedTuple):
    """magnet_per_k: temperature coefficient of the remanence. rest_c: at the baseline, None if it is not known."""

    magnet_per_k: float
    rest_c: float | None


CONSTANT = Warmth(0.0, None)


class SinceRest:
    """Subtracts the baseline, at its temperature, and what neighbouring pads do to the field."""

    def __init__(self, pad: Pad, mounting: ArrayMounting, repeats_allowed: Array, warmth: Warmth) -> None:
        self._mounting, self._warmth = mounting, warmth
        at_rest = mounting.gain, mounting.offset_t, mounting.noise_t, mounting.rest_field_t, repeats_allowed
        self.rest = np.array([np.ravel(each) for each in at_rest])
        # By which share of its force the silicone may have crept.
        self.silicone = float(root_of_squares(pad.silicone.creep_per_decade, pad.silicone.hysteresis))
        # Of the last frame: the change of the field around, the factor on the magnets' moments, and what C needs of it.
        self.around_t, self.moment, self.factors = np.zeros(3), 1.0, np.array([1.0, self.silicone, 1.0])

    def begin(self, temperature_c: float | None, memory: RestMemory, elapsed_s: float) -> None:
        """Of each frame, before anything is measured."""
        first_c, recovery = self._warmth.rest_c, memory.recovery
        memory.last_c = memory.last_c if temperature_c is None else temperature_c
        warmer_k = 0.0 if first_c is None or memory.last_c is None else memory.last_c - first_c
        self.moment, self.around_t = 1.0 + self._warmth.magnet_per_k * warmer_k, memory.ambient_t
        self.factors[0], self.factors[2] = self.moment, recovery.decay(elapsed_s)
        recovery.recent_t = recovery.recent_t.copy()

    def measured(
        self, aligned: Aligned, neighbours: Sequence[NeighbourEstimate], memory: RestMemory, now_t: Array | None
    ) -> tuple[Measured, bool]:
        """The change is (field / gain − offset − neighbours) / moment − rest. Its variance is that of noise, of what a
        sample is older or younger than the frame (bend), and of what earlier presses left in the silicone. The second:
        whether some samples are from before a jump of the field, some from after it.

        now_t (3N,): by how much presses change the field now; None: nothing presses, or it is not known."""
        sensors, foreign_t2, foreign_t = self._mounting.sensors, aligned.foreign_t2, None
        if neighbours:
            foreign_t, of_neighbours_t2 = change_of(sensors, neighbours)
            foreign_t2 = of_neighbours_t2 if foreign_t2 is None else foreign_t2 + of_neighbours_t2
            # Rotated chips also misread the neighbours' field, which is about uniform over the pad.
            self.around_t = memory.ambient_t + sensors.to_pad(foreign_t).mean(axis=0)
        measured = Measured.room(aligned.field_t.size, foreign_t2)
        samples = aligned.field_t, aligned.bend_t, aligned.noise_share, aligned.repeats
        change = memory.recovery.recent_t, measured.field_t, measured.variance_t2, measured.used
        foreign = None if foreign_t is None else doubles(foreign_t)
        has_jumped = _several.since_rest(self.rest, self.factors, *samples, *change, foreign, now_t)
        return measured, has_jumped


def begun(aligned: Aligned, memory: RestMemory, longest_gap_s: float, forget: Callable[[], None]) -> float:
    """The time since the last frame. After a longer gap, or where the board's clock began anew, `forget` ends the
    touch."""
    elapsed_s = aligned.elapsed_s(memory.last_us)
    memory.last_us = aligned.time_us
    if elapsed_s > longest_gap_s or aligned.began_anew:
        forget()
    return elapsed_s
