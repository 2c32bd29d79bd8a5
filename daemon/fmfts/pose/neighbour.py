"""Neighbouring pads' magnets for a pad with several: where they are, and by how much they change its field.

Such a pad does not solve them, but considers them: it subtracts the change, and widens the covariance of its field
(`change_of`). A pad with one magnet solves them: neighbour.c; and so does `fmfts-daemon
pose` (`joined`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import added, lengths, product
from fmfts.pad import Array, Magnet, Placement, SensorArray
from fmfts.pose._alignment import MOMENT_DEVIATION, REACH_M, REACH_RAD, SPEED_M_PER_S, TURN_RAD_PER_S
from fmfts.pose.dipole import dipole_derivatives, dipole_field
from fmfts.pose.problem import Part, Parts, Prior
from fmfts.pose.sighting import COLUMNS, Sighting, Where
from fmfts.pose.state import AXIS, POSITION, SIZE, Neighbour, State, tangent_basis


@dataclass(frozen=True, slots=True)
class NeighbourEstimate:
    """A neighbour's M magnets at one instant, in this pad's axes. covariance (6M, 6M).

    placement_m: deviation of its pad's place. rest_error (M, 2): see `Sighting`.
    """

    magnets: tuple[Magnet, ...]
    rest: tuple[Neighbour, ...]
    now: tuple[Neighbour, ...]
    covariance: Array
    placement_m: float
    rest_error: Array

    def field(self, sensors: SensorArray, where: Where) -> Array:
        """The field (N, 3) T of all its magnets at `where`, in sensor axes."""
        return added(self.fields(sensors, where))

    def fields(self, sensors: SensorArray, where: Where) -> list[Array]:
        """As `field`, of each magnet."""
        return [
            sensors.to_sensor(dipole_field(sensors.position_m, one.position_m, one.axis, *_strength(magnet, one)))
            for magnet, one in zip(self.magnets, where, strict=True)
        ]

    def fields_and_slope(self, sensors: SensorArray) -> tuple[list[Array], Array]:
        """The fields now, as `fields`, and the derivative (3N, 6M) of their sum by a step of the magnets."""
        fields, columns = [], []
        for magnet, now in zip(self.magnets, self.now, strict=True):
            own, by_position, by_axis = dipole_derivatives(
                sensors.position_m, now.position_m, now.axis, *_strength(magnet, now)
            )
            fields.append(sensors.to_sensor(own))
            columns += [by_position, product(by_axis, tangent_basis(now.axis)), own[:, :, None]]
        by_step = product(sensors.axes.transpose(0, 2, 1), np.concatenate(columns, axis=2))
        return fields, by_step.reshape(3 * len(sensors), -1)

    def placement_variance(self, sensors: SensorArray, changes: Sequence[Array]) -> Array:
        """(N,) T² along each axis, from errors of placement, and of what rests there: a dipole's change of field varies
        by 4/r of itself per metre. changes: of each magnet's field since it rested."""
        variance = np.zeros(len(sensors))
        for change, now, (off_m, share) in zip(changes, self.now, self.rest_error.tolist(), strict=True):
            distance = lengths(sensors.position_m - now.position_m)
            of_place = square(4.0 * self.placement_m / distance) + square(4.0 * off_m / distance)
            variance += square(change).sum(axis=1) * (of_place + square(share)) / 3.0
        return variance


def _strength(magnet: Magnet, where: Neighbour | State) -> tuple[float, float]:
    return magnet.strength_t_m3 * exp(where.log_moment), magnet.modelled_octupole_m2


@dataclass(frozen=True, slots=True)
class NeighbourView:
    """What one pad knows of another pad's magnets. placement: the other pad's, in this one's axes."""

    sighting: Sighting
    placement: Placement

    def at(self, time_ns: int) -> NeighbourEstimate:
        """The neighbour at `time_ns` (host clock), its covariance widened by the time since it was seen."""
        sighting = self.sighting
        reach_m, reach_rad = REACH_M, REACH_RAD
        if sighting.time_ns is not None:
            age_s = abs(time_ns - sighting.time_ns) * 1e-9
            reach_m, reach_rad = min(SPEED_M_PER_S * age_s, REACH_M), min(TURN_RAD_PER_S * age_s, REACH_RAD)
        count = len(sighting.magnets)
        moved = square(np.array(([reach_m] * 3 + [reach_rad] * 2 + [MOMENT_DEVIATION]) * count))
        turn = np.eye(COLUMNS * count)
        rest, now = self._placed(sighting.rest), self._placed(sighting.last)
        for number, (there, here) in enumerate(zip(sighting.last, now, strict=True)):
            own = turn[COLUMNS * number :, COLUMNS * number :]
            own[POSITION, POSITION] = self.placement.rotation
            own[AXIS, AXIS] = product(tangent_basis(here.axis).T, self.placement.rotation, tangent_basis(there.axis))
        return NeighbourEstimate(
            sighting.magnets,
            rest,
            now,
            product(turn, sighting.covariance, turn.T) + np.diag(moved),
            self.placement.tolerance_m,
            sighting.rest_error,
        )

    def _placed(self, magnets: Where) -> tuple[Neighbour, ...]:
        place, turn = self.placement, self.placement.rotation
        return tuple(Neighbour(place.point(one.position_m), product(turn, one.axis), one.log_moment) for one in magnets)


def change_of(sensors: SensorArray, seen: Sequence[NeighbourEstimate]) -> tuple[Array, Array]:
    """By how much the neighbours have changed the field since they rested, (N, 3) T in sensor axes, and the covariance
    (3N, 3N) of that."""
    change, variance = np.zeros((len(sensors), 3)), np.zeros(len(sensors))
    covariance = np.zeros((change.size, change.size))
    for other in seen:
        now, slope = other.fields_and_slope(sensors)
        changes = _less(now, other.fields(sensors, other.rest))
        change, variance = change + added(changes), variance + other.placement_variance(sensors, changes)
        covariance = covariance + product(slope, other.covariance, slope.T)
    return change, covariance + np.diag(np.repeat(variance, 3))


def _less(fields: Sequence[Array], others: Sequence[Array]) -> list[Array]:
    return [field - other for field, other in zip(fields, others, strict=True)]


def with_rest(field_t: Array, sensors: SensorArray, seen: Sequence[NeighbourEstimate]) -> Array:
    """Add the field of the neighbours at rest, which the baseline subtracted, to the field (N, 3) T again."""
    return field_t + sum(other.field(sensors, other.rest) for other in seen)


def joined(start: State, parts: Parts, prior: Prior, seen: Sequence[NeighbourEstimate]) -> tuple[State, Parts, Prior]:
    """Add the neighbours to start, parts and prior of a problem."""
    now = tuple(chain.from_iterable(other.now for other in seen))
    columns = SIZE + COLUMNS * len(now)
    covariance = np.zeros((columns, columns))
    covariance[:SIZE, :SIZE] = prior.covariance
    first = SIZE
    for other in seen:
        own = slice(first, first + len(other.covariance))
        covariance[own, own], first = other.covariance, own.stop
    others = np.full(COLUMNS * len(now), Part.PRIOR, dtype=parts.dtype)
    return (
        replace(start, neighbours=now),
        np.concatenate([parts, others]),
        Prior(replace(prior.mean, neighbours=now), covariance),
    )


def their_magnets(seen: Sequence[NeighbourEstimate]) -> list[Magnet]:
    """Of the neighbours that `joined` adds, in its order."""
    return [magnet for other in seen for magnet in other.magnets]
