"""The pose route of a force set: poses of one known magnet from single values, clipped ones as bounds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmfts.pad import Array, Pad
from fmfts_calibrate.field_table import DataError, mounting_of
from fmfts_calibrate.tracked import Scene
from fmfts_skin.calibrate.force_fit import Presses
from fmfts_skin.calibrate.force_set import ForceSet
from fmfts_skin.pose_values import NAMES, PoseValues

# The position turns and grows as one, and so does the tilt.
PART, AXIS = np.array([0, 0, 0, 1, 1]), np.array([0, 1, 2, 0, 1])


def pose_presses(data: ForceSet, pad: Pad, scene: Scene, noise_t: float, baseline: Path | None = None) -> Presses:
    """Each session's poses from its own rest, or from the one that `baseline` tells for all of them.

    Rows whose values tell no pose have NaN. Raises DataError for a set of other sensors.
    """
    field_t, bound_t = (_by_sensor(data, values, pad) for values in (data.field_ut, data.bound_ut))
    mounting = None if baseline is None else mounting_of(baseline, pad)
    values = np.full((len(field_t), len(NAMES)), np.nan)
    for session in np.unique(data.session):
        rows = np.flatnonzero(data.session == session)
        rest_t = _by_sensor(data, data.rest_ut(int(session))[None], pad)[0]
        poses = PoseValues(pad, rest_t, scene, noise_t, mounting)
        if not np.isfinite(poses.solver.remanence_t):
            raise DataError(f"session {data.sessions[session]!r}: no magnet of this pad explains its rest field")
        values[rows] = poses.find(field_t[rows], bound_t[rows])
    return Presses("pose", NAMES, values, PART, AXIS, data.force_n, data.session)


def _by_sensor(data: ForceSet, values: Array, pad: Pad) -> Array:
    """(K, N, 3) tesla, NaN for axes that the set does not have."""
    sensors = int(data.sensor.max()) + 1
    if sensors != len(pad.sensors):
        raise DataError(f"the set has fields of {sensors} sensors, and pad {pad.geometry_hash} has {len(pad.sensors)}")
    out = np.full((len(values), sensors, 3), np.nan)
    out[:, data.sensor, data.axis] = values * 1e-6
    return out
