"""From poses of all magnets of a pad to the fields of its message."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product, root_of_squares
from fmfts.bus.messages import PoseMessage, Vector
from fmfts.pipeline import _pad
from fmfts.pose.magnets import CHANGE, Magnets
from fmfts.several.estimator import FingersEstimator
from fmfts.several.free_poses import FreePoses
from fmfts.several.poses_estimator import PosesEstimator
from fmfts.several.reading import PosesReading

Array = NDArray[np.float64]


def poses_told(reading: PosesReading, estimator: PosesEstimator) -> dict[str, Any]:
    """The fields of a message of a pad without a table of presses. Displacement: of the magnet that moved most."""
    poses = reading.poses
    if poses is None:
        return {}
    away_m, deviation_m = max(_distances(poses))
    residual_t = residual_of(poses.misfit_t, reading.used)
    ambient = None if reading.touched else poses.ambient_t
    variance = poses.variance.reshape(-1, CHANGE)
    return {
        "contact": reading.touched,
        "displacement_m": away_m,
        "displacement_sd_m": deviation_m,
        "poses": magnets_told(estimator, poses.magnets, variance, residual_t, poses.chi2, ambient),
    }


def _distances(poses: FreePoses) -> list[tuple[float, float]]:
    """How far each magnet is from rest, and the deviation of that."""
    each = [slice(first, first + CHANGE) for first in range(0, len(poses.change), CHANGE)]
    return [_pad.distance(poses.change[own], poses.covariance[own, own].copy()) for own in each]


def residual_of(misfit_t: Array, used: NDArray[np.bool_]) -> float:
    """Root mean square of the values that were used (N, 3)."""
    residual = misfit_t if used.all() else misfit_t[used.ravel()]
    return float(np.sqrt(product(residual, residual) / len(residual)))


def magnets_told(
    estimator: FingersEstimator | PosesEstimator,
    magnets: Magnets,
    variance: Array,
    residual_t: float,
    chi2: float,
    ambient_change_t: Array | None = None,
) -> list[PoseMessage]:
    """The pose of each magnet. variance (M, 5): of its change since rest. ambient_change_t (3,): of the ambient field
    since the baseline; None if it is not published."""
    mounting, at_rest, ambient, ambient_deviation = estimator.mounting, estimator.at_rest, None, None
    if mounting.ambient_t is not None and mounting.ambient_deviation_t is not None and ambient_change_t is not None:
        deviation_t = root_of_squares(mounting.ambient_deviation_t, at_rest.ambient_deviation_t(ambient_change_t))
        ambient, ambient_deviation = _vector(mounting.ambient_t + ambient_change_t), _vector(deviation_t)
    return [
        PoseMessage(
            position_m=where.position_m,
            position_sd_m=where.position_sd_m,
            axis=where.axis,
            axis_sd_rad=where.axis_sd_rad,
            remanence_t=remanence_t,
            remanence_sd_t=remanence_sd_t,
            ambient_t=ambient,
            ambient_sd_t=ambient_deviation,
            residual_t=residual_t,
            chi2=chi2,
        )
        for where, (remanence_t, remanence_sd_t) in zip(
            at_rest.described(magnets, variance), at_rest.remanences, strict=True
        )
    ]


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
