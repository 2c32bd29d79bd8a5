"""The change of pose from rest. Contact depends on it alone, because errors of the mounting cancel in it."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import length, product
from fmfts.pad import Pad
from fmfts.pose.solver import PoseEstimate
from fmfts.pose.state import State, tangent_basis

Array = NDArray[np.float64]


def change_from(rest: State, estimate: PoseEstimate) -> Array:
    """Change (5,) of position (m), and of the axis in the tangent plane of the rest axis (rad)."""
    return np.concatenate([estimate.position_m - rest.position_m, product(tangent_basis(rest.axis).T, estimate.axis)])


def displacement(estimate: PoseEstimate, rest: State) -> tuple[Array, Array]:
    """The change (5,) as `change_from` gives it, and its covariance (5, 5)."""
    basis, change = tangent_basis(rest.axis), change_from(rest, estimate)
    project = np.zeros((5, 6))
    project[:3, :3] = np.eye(3)
    project[3:, 3:] = basis.T
    return change, product(project, estimate.pose_covariance, project.T)


def distance(change: Array, covariance: Array) -> tuple[float, float]:
    """How far (m) a change (5,) of pose moved the magnet's centre, and the deviation along that direction."""
    moved, spread = change[:3], covariance[:3, :3]
    size = length(moved)
    # A change of exactly zero has no direction: then the largest deviation of the three.
    variance = float(product(moved, spread, moved)) / (size * size) if size > 0.0 else float(np.diagonal(spread).max())
    return size, sqrt(max(variance, 0.0))


def widened(estimate: PoseEstimate, rest: State, covariance: Array) -> PoseEstimate:
    """Add a covariance (5, 5) of a change of pose, as `displacement` returns it, to that of the estimate."""
    turn = np.eye(5)
    turn[3:, 3:] = product(tangent_basis(estimate.axis).T, tangent_basis(rest.axis))
    wider = estimate.covariance.copy()
    wider[:5, :5] += product(turn, covariance, turn.T)
    return replace(estimate, covariance=wider)


def in_nominal_frame(estimate: PoseEstimate, rest: State, drawing: Pad) -> tuple[Array, Array, Array]:
    """The pose that the drawing's pad would have under the same load: position (3,), axis (3,), covariance (6, 6).

    The position is the drawing's rest plus the displacement. The axis is turned by the rotation that takes this pad's
    rest axis to the drawing's. The two differ by a degree or so: the load's own tilt is then right to second order.
    """
    position = drawing.rest_position_m + (estimate.position_m - rest.position_m)
    turn = shortest_rotation(rest.axis, drawing.rest_axis)
    spread = np.eye(6)
    spread[3:, 3:] = turn
    return position, product(turn, estimate.axis), product(spread, estimate.pose_covariance, spread.T)


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
