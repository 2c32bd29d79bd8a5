"""The magnets of a pad with several, for neighbouring pads that measure their fields."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import log
from fmfts.arithmetic.matrix import product, root_of_squares
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.pose.magnets import CHANGE, Magnets
from fmfts.pose.sighting import COLUMNS
from fmfts.pose.state import Neighbour, tangent_basis
from fmfts.several.free_poses import FreePoses
from fmfts.several.poses import Poses

Array = NDArray[np.float64]


def rest_of(mounting: ArrayMounting) -> tuple[tuple[Neighbour, ...], Array]:
    """The magnets at rest, and their uncertainty (M, 2): see `Sighting.rest_error`."""
    variance = np.maximum(np.diagonal(mounting.rest_covariance), 0.0).reshape(-1, COLUMNS)
    off_m, tilt_rad, share = (np.sqrt(variance[:, own].max(axis=1)) for own in (slice(3), slice(3, 5), slice(5, 6)))
    resting = mounting.magnets.changed(np.zeros(CHANGE * len(variance)), mounting.frames)
    return _seen(mounting, resting, 0.0), np.stack([off_m, root_of_squares(tilt_rad, share)], axis=1)


def sighted(
    mounting: ArrayMounting, poses: Poses | FreePoses, moment: float, moment_deviation: float
) -> tuple[tuple[Neighbour, ...], Array]:
    """The magnets with these poses, and the covariance (6M, 6M) of a step from there.

    moment: factor on all moments since the baseline, known to moment_deviation.
    """
    where, count = _seen(mounting, poses.magnets, log(moment)), len(mounting.magnets)
    by_change = np.zeros((count, COLUMNS, count, CHANGE))
    for number, (one, frame) in enumerate(zip(where, mounting.frames, strict=True)):
        local = product(frame.T, one.axis)
        by_tilt = frame[:, :2] - frame[:, 2:] * (local[:2] / local[2])
        by_change[number, :3, number, :3] = np.eye(3)
        by_change[number, 3:5, number, 3:] = product(tangent_basis(one.axis).T, by_tilt)
    flat = by_change.reshape(COLUMNS * count, CHANGE * count)
    of_moment = np.tile(np.append(np.zeros(CHANGE), moment_deviation), count)
    return where, product(flat, poses.covariance, flat.T) + np.outer(of_moment, of_moment)


def _seen(mounting: ArrayMounting, magnets: Magnets, log_moment: float) -> tuple[Neighbour, ...]:
    each = zip(magnets.position_m, magnets.axis, mounting.log_moment.tolist(), strict=True)
    return tuple(Neighbour(position, axis, log_moment + own) for position, axis, own in each)
