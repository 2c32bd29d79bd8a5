"""What the messages of a mounted pad with several magnets need, as fingers.h has it."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product, root_of_squares
from fmfts.common.record import Record, Values
from fmfts.pipeline import _pad
from fmfts.several.estimator import FingersEstimator
from fmfts.several.poses_estimator import PosesEstimator

REST = 6  # numbers of a magnet at rest: position, tilt and log moment
NOT_MEASURED = np.full(3, np.nan)


def mounted_record(estimator: FingersEstimator | PosesEstimator | None) -> Record:
    """None: the pad has no baseline, and its messages tell nothing."""
    record = Record(_pad.MOUNTED)
    if estimator is not None:
        record.fill(_at_rest(estimator))
        record.fill(_ambient(estimator))
    if isinstance(estimator, FingersEstimator):
        record.put("silicone_share", float(root_of_squares(estimator.silicone, estimator.scene.silicone)))
        record.put("quiet_force_sd_n", estimator.quiet_force_sd_n)
        record.put("scale_n", estimator.response.scale_n)
    return record


def _at_rest(estimator: FingersEstimator | PosesEstimator) -> Values:
    mounting = estimator.mounting
    variance = np.maximum(np.diagonal(mounting.rest_covariance), 0.0).reshape(-1, REST)
    remanence_t = np.array(mounting.remanences_t(estimator.pad))
    return {
        "magnets": np.array(len(variance)),
        "rest_variance": variance,
        "remanence_t": remanence_t,
        "remanence_deviation_t": remanence_t * np.sqrt(variance[:, -1]),
    }


def _ambient(estimator: FingersEstimator | PosesEstimator) -> Values:
    """The mean over the sensors: of their noise, and of the remaining errors of gains and rotations."""
    mounting, count = estimator.mounting, len(estimator.pad.sensors)
    by_ambient = mounting.sensors.axes.transpose(0, 2, 1).reshape(3 * count, 3)
    own = mounting.errors.by_field.reshape(len(by_ambient), -1)
    error = product(by_ambient.T, own).reshape(3, 3, -1) / count
    noise = square(mounting.noise_t / mounting.gain).ravel()
    measured = mounting.ambient_t is not None and mounting.ambient_deviation_t is not None
    return {
        "ambient_t": np.array(mounting.ambient_t if measured else NOT_MEASURED),
        "ambient_deviation_t": np.array(mounting.ambient_deviation_t if measured else NOT_MEASURED),
        "causes": np.array(error.shape[2]),
        "ambient_error": error.swapaxes(1, 2),
        "ambient_noise_t2": product(square(by_ambient).T, noise) / square(float(count)),
    }
