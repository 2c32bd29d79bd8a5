"""From a reading of several fingers to its message: each finger, and their resultant in the fields of one contact."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.bus.messages import FingerMessage, PoseMessage
from fmfts.pipeline.poses_message import magnets_told, residual_of
from fmfts.pose.magnets import CHANGE
from fmfts.several.count import resultant
from fmfts.several.estimator import FingersEstimator
from fmfts.several.fit import Fit
from fmfts.several.reading import FingersReading
from fmfts.several.resultant import deviation_of, deviation_of_each

Array = NDArray[np.float64]
SHEAR = ("shear_x_n", "shear_x_sd_n", "shear_y_n", "shear_y_sd_n")


def fingers_told(reading: FingersReading, estimator: FingersEstimator) -> dict[str, Any]:
    """The fields of a message from a reading; the poses alone if no fingers explain the field."""
    fit, free = reading.fit, reading.free
    if fit is not None:
        told = _estimates(reading, fit, estimator)
        if not reading.over_range:  # the effect of fingers beyond the table is unknown
            told["poses"] = _poses(reading, fit, estimator)
        return told
    if free is None:
        return {}
    residual_t = residual_of(free.misfit_t, reading.used)
    variance = free.variance.reshape(-1, CHANGE)
    return {"contact": True, "poses": magnets_told(estimator, free.magnets, variance, residual_t, free.chi2)}


def _poses(reading: FingersReading, fit: Fit, estimator: FingersEstimator) -> list[PoseMessage]:
    """The pose of each magnet: from the fingers and the table of presses, and from the residual's information on
    shear."""
    magnets, variance = estimator.poses(reading)
    # Under a finger the deviation of the ambient field is larger than this, but is not kept.
    ambient = None if len(fit.fingers) else fit.ambient_t
    return magnets_told(estimator, magnets, variance, residual_of(fit.misfit_t, reading.used), fit.chi2, ambient)


def _estimates(reading: FingersReading, fit: Fit, estimator: FingersEstimator) -> dict[str, Any]:
    """Beyond the table's range there is only a lower bound of the force. Without a finger there is no place."""
    if reading.over_range:
        force_n = float(np.minimum(fit.fingers[:, 2], estimator.response.scale_n).sum())
        return {"contact": True, "over_range": True, "force_min_n": force_n}
    if not len(fit.fingers):
        return {"contact": False, "contacts": [], "force_n": 0.0, "force_sd_n": estimator.quiet_force_sd_n}
    whole, deviation = resultant(fit.fingers), deviation_of(reading, fit)
    share = float(root_of_squares(estimator.silicone, estimator.scene.silicone))
    # Upper bound for the sum of shears: the correlation of two fingers' errors is not kept.
    shear, shear_deviation = fit.shear_n.sum(axis=0), fit.shear_deviation_n.sum(axis=0)
    each_deviation = deviation_of_each(reading, fit)
    fingers = zip(reading.ids, fit.fingers, each_deviation, fit.shear_n, fit.shear_deviation_n, strict=True)
    return {
        "contact": True,
        "contacts": [FingerMessage(id=number, **_finger(share, *each)) for number, *each in fingers],
        **_finger(share, whole, deviation, shear, shear_deviation),
    }


def _finger(share: float, finger: Array, deviation: Array, shear: Array, shear_deviation: Array) -> dict[str, Any]:
    """From mm to m. share: deviation of the force from creep and from the cast. Shear is null if none is expected
    (friction 0), because it is not certain to be zero."""
    (x, y, force), (x_sd, y_sd, force_sd) = finger.tolist(), deviation.tolist()
    force_sd = float(root_of_squares(force_sd, share * force))
    (shear_x, shear_y), (shear_x_sd, shear_y_sd) = shear.tolist(), shear_deviation.tolist()
    of_shear: dict[str, Any] = dict.fromkeys(SHEAR)
    if shear_x_sd > 0.0 and shear_y_sd > 0.0:
        of_shear = dict(zip(SHEAR, (shear_x, shear_x_sd, shear_y, shear_y_sd), strict=True))
    return of_shear | {
        "x_m": x * 1e-3,
        "x_sd_m": x_sd * 1e-3,
        "y_m": y * 1e-3,
        "y_sd_m": y_sd * 1e-3,
        "force_n": max(force, 0.0),
        "force_sd_n": force_sd,
    }
