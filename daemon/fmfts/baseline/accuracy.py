"""The accuracy of a mounting: figures to compare before and after --turn or --refine."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product
from fmfts.baseline.mounting import Mounting
from fmfts.baseline.sensitivity import relative_covariance
from fmfts.pad import Pad
from fmfts.pose import FREE_FIELD

# How 1 N at (4, 4) mm moves the magnet of the standard pad, in m and rad.
PRESS_1N = np.array([-1.8e-5, -1.8e-5, -7.7e-4, 0.03, 0.03])
DEPTH = 2


def accuracy(mounting: Mounting, pad: Pad) -> dict[str, float]:
    """Standard deviations, each an rms over the sensors: of gains and rotations (rad) relative to each other, of
    cross-axis sensitivities and of sensor places (m); and that of the remanence (T).

    And for a press of about 1 N, of the change of pose: sideways (m), and in depth, as a force (N). Empty if no rest
    was recorded.
    """
    leftover = mounting.leftover
    if leftover is None:
        return {}
    scale = leftover.unknowns.deviation
    covariance = leftover.covariance * scale * scale[:, None]
    first = 9 + 3 * len(pad.sensors)
    gain, rotation, cross_axis = np.sqrt(np.diagonal(relative_covariance(covariance[first:, first:]))).reshape(3, -1)
    by_change = mounting.change_error(FREE_FIELD)[:5]  # in a constant ambient field
    error = product(PRESS_1N, by_change.reshape(5, -1)).reshape(5, -1)
    press = np.sqrt(square(error).sum(axis=1))
    return {
        "gain_sd": _rms(gain),
        "sensor_rotation_sd_rad": _rms(rotation),
        "cross_axis_sd": _rms(cross_axis),
        "sensor_place_sd_m": _rms(np.sqrt(np.diagonal(covariance)[9:first])),
        "remanence_sd_t": float(np.sqrt(covariance[5, 5])) * mounting.remanence_t(pad),
        "press_1n_sideways_sd_m": _rms(press[:2]),
        "press_1n_force_sd_n": float(press[DEPTH] / abs(PRESS_1N[DEPTH])),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(square(values))))
