"""The state of a magnet, and small steps from it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import length, product
from fmfts.pad import Pad

Array = NDArray[np.float64]

# Columns of a step: position (3), axis (2, in the tangent plane), log moment (1), uniform ambient field (3), its
# gradient (5); then position, axis and log moment of each neighbour.
POSITION = slice(0, 3)
AXIS = slice(3, 5)
LOG_MOMENT = 5
AMBIENT = slice(6, 9)
GRADIENT = slice(9, 14)
SIZE = 14
NEIGHBOUR_SIZE = 6
COLUMN_NAMES = (
    *("x", "y", "z", "tilt 1", "tilt 2", "moment"),
    *("ambient x", "ambient y", "ambient z"),
    *("gradient xx", "gradient xy", "gradient xz", "gradient yy", "gradient yz"),
)

# Lengths of a state as one vector, as the kernel holds it: like a step, but with three components for each axis.
VALUES = 15
NEIGHBOUR_VALUES = 7


@dataclass(frozen=True, slots=True)
class Neighbour:
    """Another magnet in the same state. position_m (3,), axis (3,) unit vector, log_moment: as in `State`."""

    position_m: Array
    axis: Array
    log_moment: float

    def stepped(self, step: Array) -> Neighbour:
        """Moved by `step` (6,)."""
        moved = self.position_m + step[POSITION]
        return replace(
            self,
            position_m=moved,
            axis=turned(self.axis, step[AXIS]),
            log_moment=self.log_moment + float(step[LOG_MOMENT]),
        )

    def step_from(self, origin: Neighbour | State) -> Array:
        """The step (6,) that takes `origin` here."""
        moved = self.position_m - origin.position_m
        return np.concatenate([moved, turn_between(origin.axis, self.axis), [self.log_moment - origin.log_moment]])


@dataclass(frozen=True, slots=True)
class State:
    """Magnet pose, strength and ambient field.

    position_m (3,). axis (3,): unit vector. log_moment: ln(remanence / nominal remanence). ambient_t (3,): in pad axes
    at the pad's origin, without what the baseline subtracts. gradient_t_per_m (5,): xx, xy, xz, yy, yz of its gradient,
    which is symmetric (no curl) and traceless (no divergence). neighbours: other magnets that are felt.
    """

    position_m: Array
    axis: Array
    log_moment: float
    ambient_t: Array
    gradient_t_per_m: Array = field(default_factory=lambda: np.zeros(5))
    neighbours: tuple[Neighbour, ...] = ()

    @classmethod
    def at_rest(cls, pad: Pad) -> State:
        return cls(pad.rest_position_m, pad.rest_axis, 0.0, np.zeros(3))

    @classmethod
    def from_vector(cls, values: Array) -> State:
        """The inverse of `vector`."""
        others = values[VALUES:].reshape(-1, NEIGHBOUR_VALUES)
        neighbours = tuple(Neighbour(other[:3], other[3:6], float(other[6])) for other in others)
        return cls(values[:3], values[3:6], float(values[6]), values[7:10], values[10:15], neighbours)

    @property
    def columns(self) -> int:
        """Length of a step."""
        return SIZE + NEIGHBOUR_SIZE * len(self.neighbours)

    def vector(self) -> Array:
        """All values (15 + 7·neighbours,): position, axis, log moment, ambient, gradient, then the neighbours."""
        parts = [self.position_m, self.axis, np.array([self.log_moment]), self.ambient_t, self.gradient_t_per_m]
        for other in self.neighbours:
            parts += [other.position_m, other.axis, np.array([other.log_moment])]
        return np.concatenate(parts)

    def stepped(self, step: Array) -> State:
        """The state moved by `step` (columns, or fewer: the others stay), in SI units and radians."""
        whole = np.zeros(self.columns)
        whole[: len(step)] = step
        rest = whole[SIZE:].reshape(-1, NEIGHBOUR_SIZE)
        return replace(
            self,
            position_m=self.position_m + whole[POSITION],
            axis=turned(self.axis, whole[AXIS]),
            log_moment=self.log_moment + float(whole[LOG_MOMENT]),
            ambient_t=self.ambient_t + whole[AMBIENT],
            gradient_t_per_m=self.gradient_t_per_m + whole[GRADIENT],
            neighbours=tuple(other.stepped(move) for other, move in zip(self.neighbours, rest, strict=True)),
        )

    def step_from(self, origin: State) -> Array:
        """The step (columns,) that takes `origin` here: the inverse of `stepped`."""
        step = np.empty(self.columns)
        step[POSITION] = self.position_m - origin.position_m
        step[AXIS] = turn_between(origin.axis, self.axis)
        step[LOG_MOMENT] = self.log_moment - origin.log_moment
        step[AMBIENT] = self.ambient_t - origin.ambient_t
        step[GRADIENT] = self.gradient_t_per_m - origin.gradient_t_per_m
        for index, (other, before) in enumerate(zip(self.neighbours, origin.neighbours, strict=True)):
            step[SIZE + NEIGHBOUR_SIZE * index :][:NEIGHBOUR_SIZE] = other.step_from(before)
        return step


def turned(axis: Array, step: Array) -> Array:
    """The unit vector `axis` (3,) moved by `step` (2,) in its tangent plane, and brought back to the sphere."""
    moved: Array = axis + product(tangent_basis(axis), step)
    return moved / length(moved)


def turn_between(start: Array, end: Array) -> Array:
    """The step (2,) that `turned` needs from `start` to `end`."""
    # A step reaches less than 90°. Beyond that, the projection on the tangent plane still has the right direction.
    step: Array = product(tangent_basis(start).T, end) / max(product(start, end), 1e-3)
    return step


def turn_derivative(start: Array, end: Array) -> Array:
    """Derivative (3, 2) of `turned(start, step)` by the step, at `end`; equals `tangent_basis` at `start`."""
    along: Array = tangent_basis(start)
    derivative: Array = product(start, end) * (along - np.outer(end, product(end, along)))
    return derivative


def tangent_basis(axis: Array) -> Array:
    """Two orthonormal vectors (3, 2) perpendicular to the unit vector `axis`; smooth wherever the axis is not −z.

    Duff et al., "Building an orthonormal basis, revisited", JCGT 6 (2017).
    """
    x, y, z = axis
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1.0 + sign * x * x * a, b], [sign * b, sign + y * y * a], [-sign * x, -y]])
