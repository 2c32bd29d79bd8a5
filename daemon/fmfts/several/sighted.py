"""Where a pad with several magnets sees its magnets: for its messages, and for pads beside it that feel their fields.

The table of presses tells the poses that the fingers cause, but what it only considers (shear, patch, its own errors)
moves the magnets, too. So the residual is asked about it. With the fingers x ± Σ, what is considered p ~ N(0, 1), the
poses A x + B p, and the field J x + P (B p) of covariance C (field_model.py), the most likely poses given the residual
r are

    A x + W r,  W = B B' P' C⁻¹,  with the covariance  B B' − W P B B' + (A − W J) Σ (A − W J)'
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import log, square
from fmfts.arithmetic.matrix import product, root_of_squares, solve_lower
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.pose.magnets import CHANGE
from fmfts.pose.neighbour import COLUMNS
from fmfts.pose.state import Neighbour, tangent_basis
from fmfts.several.fit import Fit, Fitter, Measured

Array = NDArray[np.float64]

# Of each magnet, in m and components of the axis: by what is too weak to be told as a finger, and by silicone that has
# not come back yet from a press.
UNFELT = np.array([1e-5, 1e-5, 2e-5, 2e-3, 2e-3])


def rest_of(mounting: ArrayMounting) -> tuple[tuple[Neighbour, ...], Array]:
    """The magnets at rest, and what is not known of them (M, 2): see `Sighting.rest_error`."""
    variance = np.maximum(np.diagonal(mounting.rest_covariance), 0.0).reshape(-1, COLUMNS)
    off_m, tilt_rad, share = (np.sqrt(variance[:, own].max(axis=1)) for own in (slice(3), slice(3, 5), slice(5, 6)))
    return _placed(mounting, np.zeros(CHANGE * len(variance)), 0.0), np.stack(
        [off_m, root_of_squares(tilt_rad, share)], axis=1
    )


class Poses(NamedTuple):
    """change (5M,): of the magnets' poses since rest, in m and components of the axis. Its covariance is
    moves moves' − told told' + by_finger fingers by_finger'; moves, told, by_finger (5M, …), fingers (3K, 3K)."""

    change: Array
    moves: Array
    told: Array
    by_finger: Array
    fingers: Array

    @property
    def covariance(self) -> Array:
        """(5M, 5M)."""
        own = product(self.moves, self.moves.T) - product(self.told, self.told.T)
        covariance: Array = own + product(self.by_finger, self.fingers, self.by_finger.T)
        return covariance

    @property
    def variance(self) -> Array:
        """(5M,) the diagonal of the covariance."""
        own = square(self.moves).sum(axis=1) - square(self.told).sum(axis=1)
        variance: Array = own + (product(self.by_finger, self.fingers) * self.by_finger).sum(axis=1)
        return np.maximum(variance, 0.0)


def poses_of(fitter: Fitter, fit: Fit, measured: Measured, around_t: Array) -> Poses:
    """Where the fingers, and what moves magnets besides, have moved the magnets of a frame.

    around_t (3,): the change of the field around, as `Fitter.fit` has it.
    """
    model, used = fitter.model, measured.used
    predicted = model.predict(fit.fingers)
    unfelt = np.diag(np.tile(UNFELT, len(predicted.change) // CHANGE))
    if not len(fit.fingers):
        nothing = np.zeros((len(unfelt), 0))
        return Poses(predicted.change, unfelt, nothing, nothing, fit.covariance)
    root, poses = fitter.whitener(fit.fingers, measured, around_t), len(predicted.change)
    white = solve_lower(root, np.column_stack([predicted.by_pose, predicted.slope, fit.misfit_t])[used])
    moves = model.considered_moves(fit.fingers, predicted)
    # Of what is considered: B (L⁻¹ P B)', with C = L L'.
    told = product(moves, product(white[:, :poses], moves).T)
    change = predicted.change + product(told, white[:, -1])
    left = model.by_finger(predicted) - product(told, white[:, poses:-1])
    return Poses(change, np.concatenate([unfelt, moves], axis=1), told, left, fit.covariance)


def sighted(
    mounting: ArrayMounting, poses: Poses, moment: float, moment_deviation: float
) -> tuple[tuple[Neighbour, ...], Array]:
    """The magnets with these poses, and the covariance (6M, 6M) of a step from there.

    moment: factor on all moments since the baseline, known to moment_deviation.
    """
    where, count = _placed(mounting, poses.change, log(moment)), len(mounting.magnets)
    by_change = np.zeros((count, COLUMNS, count, CHANGE))
    for number, (one, frame) in enumerate(zip(where, mounting.frames, strict=True)):
        local = product(frame.T, one.axis)
        by_tilt = frame[:, :2] - frame[:, 2:] * (local[:2] / local[2])
        by_change[number, :3, number, :3] = np.eye(3)
        by_change[number, 3:5, number, 3:] = product(tangent_basis(one.axis).T, by_tilt)
    flat = by_change.reshape(COLUMNS * count, CHANGE * count)
    of_moment = np.tile(np.append(np.zeros(CHANGE), moment_deviation), count)
    return where, product(flat, poses.covariance, flat.T) + np.outer(of_moment, of_moment)


def _placed(mounting: ArrayMounting, change: Array, log_moment: float) -> tuple[Neighbour, ...]:
    moved = mounting.magnets.changed(change, mounting.frames)
    each = zip(moved.position_m, moved.axis, mounting.log_moment.tolist(), strict=True)
    return tuple(Neighbour(position, axis, log_moment + own) for position, axis, own in each)
