"""A neighbour's magnet as an unknown in a pad's state. Its prior is where its own pad saw it last.

The baseline already subtracts the field of the neighbour at rest. The modelled rest field is therefore added again, and
the solve models the neighbour where it is now: only the change between the two counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import lengths, product
from fmfts.pad import Array, Magnet, Placement, SensorArray
from fmfts.pose.dipole import dipole_field
from fmfts.pose.problem import Part, Parts, Prior
from fmfts.pose.solver import PoseEstimate
from fmfts.pose.state import AXIS, NEIGHBOUR_SIZE, POSITION, SIZE, Neighbour, State, tangent_basis

# The largest speed of a magnet in a tap of 1 N in 50 ms: how far it may have moved since it was seen.
SPEED_M_PER_S, TURN_RAD_PER_S = 0.02, 2.0
# A magnet that was not seen for long is still in its pad: the paper's hardest press moves it by 1.2 mm and 0.2 rad.
REACH_M, REACH_RAD = 1.2e-3, 0.2
# A log moment is never known better: it warms between two temperatures, and a dipole stands for a cylinder.
MOMENT_DEVIATION = 1e-3
COLUMNS = NEIGHBOUR_SIZE


@dataclass(slots=True)
class Sighting:
    """Where a pad's magnet was last seen, in the pad's own axes. covariance (6, 6): of a step from there.

    time_ns: when, on the host's clock; None if never: the magnet is then assumed at rest.
    """

    magnet: Magnet
    rest: State
    last: State
    covariance: Array
    time_ns: int | None = None

    @classmethod
    def unseen(cls, magnet: Magnet, rest: State) -> Sighting:
        return cls(magnet, rest, rest, np.zeros((COLUMNS, COLUMNS)))

    def rests(self, rest: State) -> None:
        """Begin again from the rest state of a new baseline."""
        self.rest = self.last = rest
        self.covariance, self.time_ns = np.zeros((COLUMNS, COLUMNS)), None

    def saw(self, estimate: PoseEstimate, time_ns: int) -> None:
        self.last, self.covariance, self.time_ns = estimate.state, estimate.covariance[:COLUMNS, :COLUMNS], time_ns


@dataclass(frozen=True, slots=True)
class NeighbourEstimate:
    """A neighbour at one instant, in this pad's axes. covariance (6, 6). placement_m: deviation of its pad's place."""

    magnet: Magnet
    rest: Neighbour
    now: Neighbour
    covariance: Array
    placement_m: float

    def field(self, sensors: SensorArray, where: Neighbour) -> Array:
        """The field (N, 3) T of the neighbour at `where`, in sensor axes."""
        strength = self.magnet.strength_t_m3 * exp(where.log_moment)
        octupole_m2 = self.magnet.modelled_octupole_m2
        return sensors.to_sensor(dipole_field(sensors.position_m, where.position_m, where.axis, strength, octupole_m2))


@dataclass(frozen=True, slots=True)
class NeighbourView:
    """What one pad knows of another pad's magnet. placement: the other pad's, in this one's axes."""

    sighting: Sighting
    placement: Placement

    def at(self, time_ns: int) -> NeighbourEstimate:
        """The neighbour at `time_ns` (host clock), its covariance widened by the time since it was seen."""
        sighting = self.sighting
        reach_m, reach_rad = REACH_M, REACH_RAD
        if sighting.time_ns is not None:
            age_s = abs(time_ns - sighting.time_ns) * 1e-9
            reach_m, reach_rad = min(SPEED_M_PER_S * age_s, REACH_M), min(TURN_RAD_PER_S * age_s, REACH_RAD)
        moved = square(np.array([reach_m] * 3 + [reach_rad] * 2 + [MOMENT_DEVIATION]))
        turn = np.eye(COLUMNS)
        rest, now = self._placed(sighting.rest), self._placed(sighting.last)
        turn[POSITION, POSITION] = self.placement.rotation
        turn[AXIS, AXIS] = product(
            tangent_basis(now.axis).T, self.placement.rotation, tangent_basis(sighting.last.axis)
        )
        covariance = product(turn, sighting.covariance, turn.T) + np.diag(moved)
        return NeighbourEstimate(sighting.magnet, rest, now, covariance, self.placement.tolerance_m)

    def _placed(self, state: State) -> Neighbour:
        place, turn = self.placement, self.placement.rotation
        return Neighbour(place.point(state.position_m), product(turn, state.axis), state.log_moment)


def with_rest(field_t: Array, sensors: SensorArray, seen: Sequence[NeighbourEstimate]) -> Array:
    """Add the field of the neighbours at rest, which the baseline subtracted, to the field (N, 3) T again."""
    return field_t + sum(other.field(sensors, other.rest) for other in seen)


def placement_deviation(sensors: SensorArray, seen: Sequence[NeighbourEstimate]) -> Array:
    """Deviation (N, 1) T from errors of placement: a dipole's change of field varies by 4/r of itself per metre."""
    variance = np.zeros(len(sensors))
    for other in seen:
        change = other.field(sensors, other.now) - other.field(sensors, other.rest)
        distance = lengths(sensors.position_m - other.now.position_m)
        variance += square(change).sum(axis=1) * square(4.0 * other.placement_m / distance) / 3.0
    return np.sqrt(variance)[:, None]


def joined(start: State, parts: Parts, prior: Prior, seen: Sequence[NeighbourEstimate]) -> tuple[State, Parts, Prior]:
    """Add the neighbours to start, parts and prior of a problem."""
    columns = SIZE + COLUMNS * len(seen)
    covariance = np.zeros((columns, columns))
    covariance[:SIZE, :SIZE] = prior.covariance
    for index, other in enumerate(seen):
        own = slice(SIZE + COLUMNS * index, SIZE + COLUMNS * (index + 1))
        covariance[own, own] = other.covariance
    now = tuple(other.now for other in seen)
    others = np.full(COLUMNS * len(seen), Part.PRIOR, dtype=parts.dtype)
    return (
        replace(start, neighbours=now),
        np.concatenate([parts, others]),
        Prior(replace(prior.mean, neighbours=now), covariance),
    )


def without_neighbours(
    field_t: Array, estimate: PoseEstimate | None, seen: Sequence[NeighbourEstimate], sensors: SensorArray
) -> tuple[Array, PoseEstimate | None]:
    """Subtract the neighbours, where the estimate has them, from the field (N, 3), and drop them from the estimate."""
    if estimate is None or not seen:
        return field_t, estimate
    pairs = zip(seen, estimate.state.neighbours, strict=True)
    alone = replace(estimate.state, neighbours=())
    return field_t - sum(other.field(sensors, where) for other, where in pairs), replace(estimate, state=alone)
