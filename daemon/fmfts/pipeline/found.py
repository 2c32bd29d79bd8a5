"""What is found of a frame of several magnets, in the record of which C makes its message and its `now` (fingers.h).

C itself fills the record of a calm frame (_calm.c).
"""

from __future__ import annotations

from math import nan

import numpy as np

from fmfts.common.record import Numbers, Record
from fmfts.pad import Array
from fmfts.pipeline import _pad
from fmfts.pose.magnets import CHANGE, Magnets
from fmfts.several.estimator import FingersEstimator
from fmfts.several.fit import Fit
from fmfts.several.free_poses import FreePoses
from fmfts.several.poses_estimator import PosesEstimator
from fmfts.several.reading import FingersReading, PosesReading

Estimator = FingersEstimator | PosesEstimator | None
NOT_KNOWN = -1
NOTHING: dict[str, Numbers] = {
    **dict.fromkeys(("has_fingers", "has_least", "has_magnets", "more", "over_range", "count"), 0),
    "contact": NOT_KNOWN,
    "displacement_m": nan,
}


def put_fit(found: Record, fit: Fit, change_t: Array, moment: float) -> None:
    """change_t: that it was made from. moment: factor on all moments since the baseline."""
    found.fill(
        {
            "count": len(fit.fingers),
            "chi2": fit.chi2,
            "moment": moment,
            "change_t": change_t,
            "fingers": fit.fingers,
            "covariance": fit.covariance,
            "misfit_t": fit.misfit_t,
            "ambient_t": fit.ambient_t,
            "shear_n": fit.shear_n,
            "shear_deviation_n": fit.shear_deviation_n,
            "noise_t": fit.noise_t,
            "slope_t": fit.slope_t,
        }
    )


def put_reading(found: Record, reading: FingersReading | PosesReading, estimator: Estimator) -> None:
    found.fill(NOTHING)
    found.put("used", reading.used.view(np.uint8))
    if isinstance(reading, PosesReading):
        if reading.poses is not None:
            _put_free(found, reading.poses, NOT_KNOWN if reading.touched is None else reading.touched)
            _put_displacement(found, reading.poses)
        return
    found.put("more", reading.more)
    if reading.free is not None:
        _put_free(found, reading.free, contact=True)
    if reading.fit is not None and reading.measured is not None and isinstance(estimator, FingersEstimator):
        _put_fingers(found, reading, reading.fit, reading.measured.field_t, estimator)


def _put_fingers(
    found: Record, reading: FingersReading, fit: Fit, change_t: Array, estimator: FingersEstimator
) -> None:
    """No poses beyond the table, where what fingers do is unknown."""
    put_fit(found, fit, change_t, estimator.since_rest.moment)
    found.fill({"has_fingers": 1, "over_range": reading.over_range, "id": reading.ids})
    if reading.least_variance is not None:
        found.fill({"has_least": 1, "least": reading.least_variance})
    if not reading.over_range:
        _put_magnets(found, *estimator.poses(reading))


def _put_free(found: Record, poses: FreePoses, contact: int) -> None:
    """The poses that explain a frame alone."""
    found.fill({"contact": contact, "chi2": poses.chi2, "misfit_t": poses.misfit_t, "ambient_t": poses.ambient_t})
    _put_magnets(found, poses.magnets, poses.variance)


def _put_magnets(found: Record, magnets: Magnets, variance: Array) -> None:
    found.fill({"has_magnets": 1, "position": magnets.position_m, "axis": magnets.axis, "variance": variance})


def _put_displacement(found: Record, poses: FreePoses) -> None:
    """How far the magnet is from rest that moved most, and the deviation of that."""
    each = [slice(first, first + CHANGE) for first in range(0, len(poses.change), CHANGE)]
    farthest = max(_pad.distance(poses.change[own], poses.covariance[own, own].copy()) for own in each)
    found.fill(dict(zip(("displacement_m", "displacement_sd_m"), farthest, strict=True)))
