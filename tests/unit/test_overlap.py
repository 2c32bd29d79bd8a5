"""What the baseline leaves unknown counts once in the covariance of a change of pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mounted_world import NOISE_T, TOLERANCE, World

from fmfts.baseline import make_bare, make_rest
from fmfts.config import MagnetConfig, SceneConfig
from fmfts.pad import Pad
from fmfts.pose import (
    FREE_FIELD,
    PAPER,
    STOP_CONVERGED,
    State,
    displacement,
    solve,
)
from fmfts.pose.field_errors import change_since
from fmfts.scene.tracking import tracking_model_for

HAND_PLACED = replace(TOLERANCE, sensor_rotation_rad=np.radians(1.5), cross_axis=0.002)
PRESS = np.array([3e-4, -2e-4, -7e-4, 0.08, 0.05, 0.0, 0.0, 0.0, 0.0])
DRIFTING = tracking_model_for(SceneConfig(ambient="drifting"), MagnetConfig()).tracking
SCENES = pytest.mark.parametrize("tracking", [PAPER, DRIFTING], ids=["constant", "drifting"])


def counted_twice(
    pad: Pad, field_t: np.ndarray, start: State, deviation_t: np.ndarray, lasting_t: np.ndarray
) -> np.ndarray:
    """(5, 5) what independent lasting errors of each axis do to the pose: one after the other, solved again."""

    def solved(measured: np.ndarray) -> np.ndarray:
        estimate = solve(measured, pad, start, deviation_t=deviation_t, free=FREE_FIELD, stop_chi2=STOP_CONVERGED)
        return estimate.state.step_from(start)[:5]

    here, spread = solved(field_t), np.zeros((5, 5))
    for axis in range(12):
        error = np.zeros(12)
        error[axis] = 0.01 * lasting_t.ravel()[axis]  # a small one: the solver is not linear
        moved = (solved(field_t + error.reshape(4, 3)) - here) / 0.01
        spread += np.outer(moved, moved)
    return spread


def test_pose_in_another_field_is_as_uncertain_as_claimed(pad: Pad) -> None:
    """Single frames of hand-placed pads, solved with the deviations of a running pad.

    With both parts counted, χ² would be half of what it has to be.
    """
    once, twice = [], []
    for seed in range(60):
        world = World(pad, np.random.default_rng(seed))
        world.spoilt(HAND_PLACED)
        before = make_bare(pad, HAND_PLACED, world.recorded(world.bare()))
        _, mounting = make_rest(pad, HAND_PLACED, world.recorded(world.field()), before)
        turned = np.array([3e-5, -4e-5, 2e-5])
        world.earth_t = world.earth_t + turned
        field = mounting.magnet_field(world.field(world.rest.stepped(PRESS)))
        field += world.random.normal(0.0, NOISE_T, (4, 3))
        lasting = mounting.lasting_deviation_t(field, pad.sensors.to_sensor(np.tile(turned, (4, 1))))
        deviation, mounted = np.hypot(NOISE_T, lasting), mounting.mounted(pad)
        estimate = solve(field, mounted, mounting.rest, deviation_t=deviation, free=FREE_FIELD)
        truth, _ = displacement(replace(estimate, state=world.rest.stepped(PRESS)), world.rest)
        change, covariance = displacement(estimate, mounting.rest)
        error = np.tensordot(change_since(mounting.rest, estimate.state), mounting.change_error(FREE_FIELD), axes=1)
        cylinder = np.diag(np.array([2e-6, 2e-6, 2e-6, 2e-4, 2e-4]) ** 2)  # the tracker's dipole: see test_baseline.py
        counted = counted_twice(mounted, field, estimate.state, deviation, lasting)
        for found, own in ((once, covariance - counted), (twice, covariance)):
            off = change - truth
            found.append(off @ np.linalg.solve(own + error @ error.T + cylinder, off))
    # A mean of 60 χ²₅ has a deviation of 0.41.
    assert 5.0 - 4 * 0.41 < np.mean(once) < 5.0 + 4 * 0.41
    assert np.mean(twice) < 5.0 - 4 * 0.41
