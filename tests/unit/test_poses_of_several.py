"""The poses of a pad with four magnets are as wrong as they say: under shear, other patches, errors of the table."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fmfts.common.chi2 import quantile
from fmfts.pad import Array
from fmfts.pose.magnets import CHANGE
from fmfts.several.field_model import PATCH_MM2
from fmfts.several.poses import UNFELT
from fmfts_lab.bench.several_world import EXACT, SCENE, WITHIN_MM, Press, estimator_of, read_once, world

FRAMES = 150
# A correct pad fails this rarely, on either side, with its twenty numbers of pose.
FAILS = 1e-6
# A mean of x² over the patch that is larger by this: see `World.pressed`, of which 36 mm² is the table's own patch.
WIDER_MM2 = 16.0 * PATCH_MM2


@cache
def errors(fingers: int) -> Array:
    """(K, 20) errors of the poses in their own deviations. All that `field_model.py` considers is drawn as it says."""
    random, pad, errors = np.random.default_rng(fingers), world(71, EXACT), []
    estimator = estimator_of(pad)
    for _ in range(FRAMES):
        places = random.uniform(-WITHIN_MM, WITHIN_MM, (fingers, 2))
        places[:, 0] = places[:, 0] if fingers == 1 else random.uniform(-2.0, 2.0) + np.array([-8.0, 8.0])
        presses = []
        for x, y in places.tolist():
            force = random.uniform(0.4, 1.0)
            shear = random.normal(0.0, SCENE.friction * force, 2).tolist()
            patch_mm2 = max(36.0 + WIDER_MM2 * random.normal(), 1.0)
            presses.append(Press(x, y, force, *shear, float(np.sqrt(patch_mm2))))
        pressed = [pad.response.pressed(*press[:3]).change for press in presses]
        table = sum(one * random.normal(0.0, pad.response.error, one.shape) for one in pressed)
        change = pad.pressed(presses) + table * np.tile([1e-3, 1e-3, 1e-3, 1.0, 1.0], len(pad.magnets))
        warmer = pad.magnets.stronger(np.full(len(pad.magnets), random.normal(0.0, SCENE.moment)))
        ambient_t = pad.ambient_t + random.normal(0.0, SCENE.ambient_t, 3)
        reading = read_once(replace(pad, magnets=warmer, ambient_t=ambient_t), change, estimator)
        if reading.fit is None or len(reading.fit.fingers) != fingers:
            continue
        told, variance = estimator.poses(reading)
        true = pad.magnets.changed(change, pad.frames)
        axis = np.einsum("mji,mj->mi", pad.frames, told.axis - true.axis)[:, :2]
        off = np.concatenate([told.position_m - true.position_m, axis], axis=1)
        # A touch too weak to be detected is not simulated, and is part of the deviations.
        errors.append((off / np.sqrt(variance - UNFELT * UNFELT)).ravel())
    return np.array(errors)


@pytest.mark.parametrize("fingers", [1, 2])
def test_pose_errors_scatter_as_their_deviations(fingers: int) -> None:
    """Σ over the frames of (error/deviation)² is χ² for each number of pose, frames being independent."""
    found = errors(fingers)
    assert len(found) > 0.9 * FRAMES
    assert found.shape[1] == 4 * CHANGE
    sums, freedom = np.square(found).sum(axis=0), len(found)
    assert sums.max() < quantile(FAILS / found.shape[1], freedom)
    assert sums.min() > quantile(1.0 - FAILS / found.shape[1], freedom)
