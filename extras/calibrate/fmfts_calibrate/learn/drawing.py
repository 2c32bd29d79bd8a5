"""A pad's geometry as one vector of errors of its drawing, and the reported field that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmfts.baseline import sensitivity
from fmfts.pad import Pad, SensorArray, Tolerance, rotation_from_vector
from fmfts.pose import State, dipole_derivatives, dipole_field
from fmfts.pose.state import tangent_basis, turn_derivative

Array = NDArray[np.float64]

# How far the octupole of a real magnet may be from that of a cylinder of its drawing: 10 % of each of its dimensions.
OCTUPOLE_SHARE = 0.1
REST, LOG_MOMENT, OCTUPOLE, FIRST_PLACE = slice(0, 5), 5, 6, 7


@dataclass(frozen=True, slots=True)
class Geometry:
    """A possible pad. sensors: places and axes at right angles. matrix (N, 3, 3): what a chip reports of a field in
    its own axes (gains and cross-axis terms). by_rotation (N, 3, 3): how a change of a chip's rotation vector turns it.
    octupole_m2: κ of the magnet; rest: its pose and log moment, untouched."""

    rest: State
    octupole_m2: float
    sensors: SensorArray
    matrix: Array
    by_rotation: Array

    def reported(self) -> SensorArray:
        """(N,) chips without errors of their own, but for axes that need not be at right angles nor of length one."""
        rows = self.matrix @ self.sensors.axes.transpose(0, 2, 1)
        return SensorArray(self.sensors.position_m, rows.transpose(0, 2, 1))

    def at(self, position_m: Array, axis: Array) -> State:
        return replace(self.rest, position_m=position_m, axis=axis)


@dataclass(frozen=True)
class Drawing:
    """A pad's drawing and its tolerances: the prior of the learned geometry.

    The vector (M,) counts deviations from the drawing in its tolerances: rest pose (5), log moment, κ, places (3N),
    rotation vectors in the chips' own axes (3N), gains (3N), cross-axis terms (3N). free_octupole: κ is unknown, too.
    """

    pad: Pad
    tolerance: Tolerance
    free_octupole: bool = False

    @cached_property
    def deviation(self) -> Array:
        """(M,) in SI."""
        count, given = 3 * len(self.pad.sensors), self.tolerance
        magnet = self.pad.magnet
        squares = magnet.length_m**2 / 4.0 + 3.0 * magnet.diameter_m**2 / 16.0
        return np.concatenate(
            [
                np.full(3, given.magnet_position_m),
                np.full(2, given.tilt_rad),
                [given.remanence, 2.0 * OCTUPOLE_SHARE * squares if self.free_octupole else 0.0],
                np.full(count, given.sensor_position_m),
                np.full(count, given.sensor_rotation_rad),
                np.full(count, given.gain),
                np.full(count, given.cross_axis),
            ]
        )

    def geometry(self, vector: Array) -> Geometry:
        count, values = len(self.pad.sensors), self.deviation * vector
        places, rotations, gains, cross = values[FIRST_PLACE:].reshape(4, count, 3)
        turned = np.array([rotation_from_vector(one) for one in rotations])
        own = np.concatenate([1.0 + gains.ravel(), np.zeros(3 * count), cross.ravel()])
        return Geometry(
            State.at_rest(self.pad).stepped(values[:6]),
            self.pad.magnet.octupole_m2 + float(values[OCTUPOLE]),
            SensorArray(self.pad.sensors.position_m + places, self.pad.sensors.axes @ turned),
            sensitivity.matrices(own),
            np.array([right_jacobian(one) for one in rotations]),
        )

    def derivatives(self, geometry: Geometry, state: State) -> tuple[Array, Array, Array]:
        """The chips' readings (3N,) of the magnet in `state`, and its derivatives by the pose (3N, 5) and by the vector
        (3N, M), as if rest and pose were one: for a press, the caller sets the columns of rest to zero.
        """
        reading, by_pose, by_vector = self.derivatives_of(geometry, [state])
        return reading[0], by_pose[0], by_vector[0]

    def derivatives_of(self, geometry: Geometry, states: Sequence[State]) -> tuple[Array, Array, Array]:
        """`derivatives` (K, …) of K states."""
        sensors, count, each = geometry.sensors, len(self.pad.sensors), np.arange(len(self.pad.sensors))
        to_chip = geometry.matrix @ sensors.axes.transpose(0, 2, 1)
        field, unit = np.zeros((2, len(states), count, 3))
        by_position, by_axis = np.empty((2, len(states), count, 3, 3))
        turn_of_rest, turn = np.empty((2, len(states), 3, 2))
        for number, state in enumerate(states):
            strength = self.pad.magnet.strength_t_m3 * float(np.exp(state.log_moment))
            here = sensors.position_m, state.position_m, state.axis, strength
            field[number], by_position[number], by_axis[number] = dipole_derivatives(*here, geometry.octupole_m2)
            if self.free_octupole:  # the field is linear in κ
                unit[number] = dipole_field(*here, geometry.octupole_m2 + 1.0) - field[number]
            turn_of_rest[number], turn[number] = (
                turn_derivative(self.pad.rest_axis, state.axis),
                tangent_basis(state.axis),
            )
        own = sensors.to_sensor(field)
        by_place = to_chip @ by_position
        columns = np.zeros((*own.shape, FIRST_PLACE + 12 * count))
        columns[..., :3] = by_place
        columns[..., 3:5] = to_chip @ by_axis @ turn_of_rest[:, None]
        columns[..., LOG_MOMENT] = (to_chip @ field[..., None])[..., 0]
        columns[..., OCTUPOLE] = (to_chip @ unit[..., None])[..., 0]
        # The chip's own part of `sensitivity`. Its rotation turns the field before that.
        by_value = np.einsum("ijv,knj->kniv", sensitivity.BY_VALUE, own).reshape(*own.shape, 3, 3)
        gains, turns, cross = np.moveaxis(by_value, 3, 0)
        by_chip = columns[..., FIRST_PLACE:].reshape(*own.shape, 4, count, 3)
        turns = geometry.matrix @ turns @ geometry.by_rotation
        for kind, values in enumerate((-by_place, turns, gains, cross)):
            by_chip[:, each, :, kind, each] = values.swapaxes(0, 1)  # NumPy puts the chips first
        by_pose = np.concatenate([by_place, to_chip @ by_axis @ turn[:, None]], axis=3)
        rows = len(states), 3 * count
        reading = (geometry.matrix @ own[..., None]).reshape(rows)
        return reading, by_pose.reshape(*rows, 5), columns.reshape(*rows, len(self.deviation)) * self.deviation


def right_jacobian(vector_rad: Array) -> Array:
    """J (3, 3): R(v + dv) = R(v)·R(J dv), to first order (Chirikjian, Stochastic Models 2, 2012, section 10.6)."""
    angle = float(np.linalg.norm(vector_rad))
    x, y, z = vector_rad
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-6:
        return np.eye(3) - cross / 2.0
    first, second = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) - first * cross + second * cross @ cross)
