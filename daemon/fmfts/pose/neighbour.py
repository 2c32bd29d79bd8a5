"""Neighbouring pads' magnets for a pad with several: where they are, and by how much they change its field.

Such a pad does not solve them, but considers them: it subtracts the change, and widens the covariance of its field
(`change_of`). A pad with one magnet solves them: neighbour.c. beside.c has the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fmfts.arithmetic.matrix import added
from fmfts.pad import Array, Magnet, Placement, SensorArray
from fmfts.pose import _alignment
from fmfts.pose.problem import magnet_rows
from fmfts.pose.sighting import COLUMNS, Sighting
from fmfts.pose.state import NEIGHBOUR_VALUES


@dataclass(frozen=True, slots=True)
class NeighbourEstimate:
    """A neighbour's M magnets at one instant, in this pad's axes. rest, now (M, 7): position, axis and log moment of
    each. covariance (6M, 6M): of a step of all.

    placement_m: deviation of its pad's place. rest_error (M, 2): see `Sighting`.
    """

    magnets: tuple[Magnet, ...]
    rest: Array
    now: Array
    covariance: Array
    placement_m: float
    rest_error: Array

    def effect(self, sensors: SensorArray) -> tuple[Array, Array, Array]:
        """The field (N, 3) T at rest, in sensor axes; its change since (N, 3); the covariance (3N, 3N) of that."""
        axes = sensors.position_m.shape
        rest_t, change_t, covariance = np.empty(axes), np.empty(axes), np.empty((3 * len(sensors),) * 2)
        _alignment.change_beside(
            np.ascontiguousarray(sensors.position_m),
            np.ascontiguousarray(sensors.axes.transpose(0, 2, 1)),
            magnet_rows(*self.magnets),
            self.rest,
            self.now,
            self.rest_error,
            self.covariance,
            self.placement_m,
            rest_t,
            change_t,
            covariance,
        )
        return rest_t, change_t, covariance


@dataclass(frozen=True, slots=True)
class NeighbourView:
    """One pad's knowledge of another pad's magnets. placement: the other pad's, in this one's axes."""

    sighting: Sighting
    placement: Placement

    def at(self, time_ns: int) -> NeighbourEstimate:
        """The neighbour at `time_ns` (host clock), its covariance widened by the time since it was seen."""
        sighting, placement, count = self.sighting, self.placement, len(self.sighting.magnets)
        rest, now = np.empty((count, NEIGHBOUR_VALUES)), np.empty((count, NEIGHBOUR_VALUES))
        covariance = np.empty((COLUMNS * count, COLUMNS * count))
        turn, place_m = np.ascontiguousarray(placement.rotation), np.ascontiguousarray(placement.position_m)
        _alignment.see(turn, place_m, sighting.table.buffer, time_ns, rest, now, covariance)
        return NeighbourEstimate(sighting.magnets, rest, now, covariance, placement.tolerance_m, sighting.rest_error)


def change_of(sensors: SensorArray, seen: Sequence[NeighbourEstimate]) -> tuple[Array, Array]:
    """The change (N, 3) of the neighbours' field since they rested, in T and sensor axes, and its covariance (3N,
    3N).
    """
    effects = [other.effect(sensors) for other in seen]
    return added([change_t for _, change_t, _ in effects]), added([covariance for _, _, covariance in effects])
