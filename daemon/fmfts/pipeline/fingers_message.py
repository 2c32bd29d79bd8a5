"""From a reading of several fingers to its message: each finger, and their resultant in the fields of one contact."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product, root_of_squares
from fmfts.baseline import Baseline
from fmfts.bus.messages import NO_ESTIMATE_OF_SEVERAL, ContactMessage, FingerMessage, PoseMessage, Vector
from fmfts.pipeline.contact_message import mask_of
from fmfts.pose import SOLVER
from fmfts.pose.magnets import CHANGE
from fmfts.several.count import resultant
from fmfts.several.estimator import FingersEstimator
from fmfts.several.fit import Fit
from fmfts.several.reading import FingersReading
from fmfts.several.resultant import deviation_of, deviation_of_each

Array = NDArray[np.float64]
SHEAR = ("shear_x_n", "shear_x_sd_n", "shear_y_n", "shear_y_sd_n")


class FingersWriter:
    """Makes the messages of one pad with several magnets, and numbers them."""

    def __init__(self, pad: str, boot: str, model: str) -> None:
        self._pad, self._boot, self._model = pad, boot, model
        self.number = 0
        self.sampled_ns = 0

    def message(
        self,
        reading: FingersReading,
        sampled_ns: int | None,
        temperature_c: float | None,
        estimator: FingersEstimator | None,
        baseline: Baseline | None,
    ) -> ContactMessage:
        """The message of a reading. sampled_ns: host time of the sample; None, without a frame, repeats the last."""
        self.sampled_ns = self.sampled_ns if sampled_ns is None else sampled_ns
        self.number += 1
        estimates: dict[str, Any] = NO_ESTIMATE_OF_SEVERAL | {"over_range": False, "more": reading.more}
        if reading.fit is not None and estimator is not None:
            estimates |= _estimates(reading, reading.fit, estimator)
            if not reading.over_range:  # what fingers beyond the table do to the magnets is not known
                estimates["poses"] = _poses(reading, reading.fit, estimator)
        return ContactMessage(
            pad=self._pad,
            boot=self._boot,
            seq=self.number,
            t_sample_ns=self.sampled_ns,
            t_publish_ns=time.monotonic_ns(),
            utc_ns=time.time_ns(),
            temperature_c=temperature_c,
            health=reading.health,
            reason=reading.reason,
            **estimates,
            sensors_ok=mask_of(reading.used),
            solver=SOLVER,
            model=self._model,
            baseline=None if baseline is None else baseline.id,
        )


def _estimates(reading: FingersReading, fit: Fit, estimator: FingersEstimator) -> dict[str, Any]:
    """Beyond the table's range there is only a lower bound of the force. Without a finger there is no place."""
    if reading.over_range:
        force_n = float(np.minimum(fit.fingers[:, 2], estimator.response.scale_n).sum())
        return {"contact": True, "over_range": True, "force_min_n": force_n}
    if not len(fit.fingers):
        return {"contact": False, "contacts": [], "force_n": 0.0, "force_sd_n": estimator.quiet_force_sd_n}
    whole, deviation, share = resultant(fit.fingers), deviation_of(reading, fit), estimator.silicone
    # Of the sum of shears at most: how the errors of two fingers go together is not kept.
    shear, shear_deviation = fit.shear_n.sum(axis=0), fit.shear_deviation_n.sum(axis=0)
    each_deviation = deviation_of_each(reading, fit)
    fingers = zip(reading.ids, fit.fingers, each_deviation, fit.shear_n, fit.shear_deviation_n, strict=True)
    return {
        "contact": True,
        "contacts": [FingerMessage(id=number, **_finger(share, *each)) for number, *each in fingers],
        **_finger(share, whole, deviation, shear, shear_deviation),
    }


def _finger(share: float, finger: Array, deviation: Array, shear: Array, shear_deviation: Array) -> dict[str, Any]:
    """From mm to m. share: of the force, by which silicone may have crept. No shear where none is expected (friction
    0): that it is none is not known so well."""
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


def _poses(reading: FingersReading, fit: Fit, estimator: FingersEstimator) -> list[PoseMessage]:
    """The pose of each magnet: by the fingers and the table of presses, and by what the residual tells of shear."""
    mounting = estimator.mounting
    magnets, variance = estimator.poses(reading)
    ambient, ambient_deviation = None, None
    # Under a finger the ambient field is known to less than this, and how much less is not kept.
    if mounting.ambient_t is not None and mounting.ambient_deviation_t is not None and not len(fit.fingers):
        deviation_t = root_of_squares(mounting.ambient_deviation_t, estimator.ambient_deviation_t(fit))
        ambient, ambient_deviation = _vector(mounting.ambient_t + fit.ambient_t), _vector(deviation_t)
    whole = np.sqrt(variance + estimator.rest_variance[:, :CHANGE]).tolist()
    residual = fit.misfit_t[reading.used.ravel()]
    residual_t = float(np.sqrt(product(residual, residual) / len(residual)))
    return [
        PoseMessage(
            position_m=(x, y, z),
            position_sd_m=(deviation[0], deviation[1], deviation[2]),
            axis=(along_x, along_y, along_z),
            axis_sd_rad=max(deviation[3], deviation[4]),
            remanence_t=remanence_t,
            remanence_sd_t=remanence_sd_t,
            ambient_t=ambient,
            ambient_sd_t=ambient_deviation,
            residual_t=residual_t,
            chi2=fit.chi2,
        )
        for (x, y, z), (along_x, along_y, along_z), deviation, (remanence_t, remanence_sd_t) in zip(
            magnets.position_m.tolist(), magnets.axis.tolist(), whole, estimator.remanences, strict=True
        )
    ]


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
