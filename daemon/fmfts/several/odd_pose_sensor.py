"""Finds the one sensor without which poses explain a frame that they do not explain with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import SingularError, inverse, product
from fmfts.several.field_model import FieldModel
from fmfts.several.free_poses import FreePoses, free_poses, is_explained
from fmfts.several.measured import Measured

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Number of sensors that are tried, one in each search: those without which χ² would fall most, to first order, best
# first.
TRIED = 3


class OddPose(NamedTuple):
    """sensor: the odd one. poses: without it."""

    sensor: int
    poses: FreePoses


class Values(NamedTuple):
    """Of a frame. there (N, 3): the values that may be used. around_t (3,): the change of the ambient field."""

    measured: Measured
    there: Mask
    around_t: Array


def odd_pose_sensor(
    model: FieldModel, poses: FreePoses, start: Array, values: Values, fewest: int, search: int
) -> OddPose | None:
    """The sensor without which the frame is explained; None if that is not the one that this search tries.

    poses: with all values. start (5M,): of a frame that was explained. fewest: values that are needed.
    search: how many searches were made before, in frames in a row that nothing explains.
    """
    measured, there, around_t = values
    best_first = np.argsort(-_gains(model, poses, measured.only(there), around_t), kind="stable")
    sensor = int(best_first[search % TRIED])
    used = there.copy()
    used[sensor] = False
    if not there[sensor].any() or np.count_nonzero(used) < fewest:
        return None
    try:
        without = free_poses(model, start, measured.only(used), around_t)
    except SingularError:
        return None  # without this sensor the others do not determine the poses
    return OddPose(sensor, without) if is_explained(without, used) else None


def _gains(model: FieldModel, poses: FreePoses, measured: Measured, around_t: Array) -> Array:
    """(N,) by how much χ² falls without each sensor, to first order: r'P (P_ss)⁻¹ P r of its values s, with the
    residual r, P = W − W J Σ J'W and W = C⁻¹; Σ is the covariance of the poses."""
    predicted, used = poses.predicted, measured.used
    covariance = model.covariance(np.zeros((0, 3)), predicted, measured.variance_t2, around_t)
    if measured.foreign_t2 is not None:
        covariance = covariance + measured.foreign_t2
    weight = inverse(covariance[np.ix_(used, used)])
    slope = product(weight, predicted.by_pose[used])
    left = weight - product(slope, poses.covariance, slope.T)
    toward = product(left, poses.misfit_t[used])
    sensors = np.flatnonzero(used) // 3
    gains = np.zeros(len(used) // 3)
    for sensor in np.unique(sensors).tolist():
        own = np.flatnonzero(sensors == sensor)
        gains[sensor] = product(toward[own], inverse(left[np.ix_(own, own)]), toward[own])
    return gains
