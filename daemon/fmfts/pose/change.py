"""The change of pose from rest. Contact depends on it alone, because errors of the mounting cancel in it: change.c."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.matrix import length, product
from fmfts.pad import Array
from fmfts.pose.state import State, tangent_basis

UPRIGHT = np.eye(3)


def change_since(rest: State, state: State) -> Array:
    """Change (8,) of position (m) and of the axis in the rest axis's tangent plane (rad), and the ambient field (T)."""
    return np.concatenate(
        [state.position_m - rest.position_m, product(tangent_basis(rest.axis).T, state.axis), state.ambient_t]
    )


def pad_turn_of(rest_axis: Array, drawn_axis: Array, share: float) -> Array:
    """The rotation (3, 3) from the sensors' axes to those of a pad that has `share` of its magnet's tilt."""
    upright = rest_axis + share * (drawn_axis - rest_axis)
    return shortest_rotation(rest_axis, upright / length(upright))


def shortest_rotation(start: Array, end: Array) -> Array:
    """Rotation (3, 3) that takes the unit vector `start` to `end`, less than 180° away."""
    x, y, z = np.array(
        [
            start[1] * end[2] - start[2] * end[1],
            start[2] * end[0] - start[0] * end[2],
            start[0] * end[1] - start[1] * end[0],
        ]
    )
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Array = np.eye(3) + cross + product(cross, cross) / (1.0 + product(start, end))
    return rotation
