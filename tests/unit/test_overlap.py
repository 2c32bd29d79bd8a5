"""What the baseline leaves unknown counts once in the covariance of a change of pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from mounted_world import NOISE_T, TOLERANCE, World
from pose_steps_in_c import SingleSteps, lasting_deviation_t

from fmfts.baseline import make_bare, make_rest
from fmfts.config import MagnetConfig, SceneConfig
from fmfts.pad import Pad
from fmfts.pose import (
    FREE_FIELD,
    PAPER,
    STOP_CONVERGED,
    Part,
    Prior,
    State,
    TrackingModel,
    dipole_field,
    solve,
    tangent_basis,
)
from fmfts.pose.change import change_since
from fmfts.pose.state import LOG_MOMENT
from fmfts.scene.tracking import tracking_model_for

HAND_PLACED = replace(TOLERANCE, sensor_rotation_rad=np.radians(1.5), cross_axis=0.002)
PRESS = np.array([3e-4, -2e-4, -7e-4, 0.08, 0.05, 0.0, 0.0, 0.0, 0.0])
DRIFTING = tracking_model_for(SceneConfig(ambient="drifting"), MagnetConfig()).tracking
Overlap = Callable[..., np.ndarray]
SCENES = pytest.mark.parametrize("tracking", [PAPER, DRIFTING], ids=["constant", "drifting"])


@pytest.fixture(scope="module")
def overlap(tmp_path_factory: pytest.TempPathFactory) -> Overlap:
    return SingleSteps(tmp_path_factory.mktemp("overlap")).overlap


def pressed_field(pad: Pad) -> tuple[State, np.ndarray]:
    state = State.at_rest(pad).stepped(PRESS)
    return state, _field(pad, state)


def _field(pad: Pad, state: State) -> np.ndarray:
    strength = pad.magnet.strength_t_m3 * np.exp(state.log_moment)
    octupole_m2 = pad.magnet.modelled_octupole_m2
    field = dipole_field(pad.sensors.position_m, state.position_m, state.axis, strength, octupole_m2)
    return pad.sensors.to_sensor(field + state.ambient_t)


def deviations(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The whole deviations (4, 3), and their lasting part: from a tenth of the noise to ten times as much."""
    lasting = NOISE_T * 10.0 ** random.uniform(-1.0, 1.0, (4, 3))
    return np.hypot(NOISE_T, lasting), lasting


@SCENES
def test_overlap_is_the_effect_of_lasting_errors_on_the_estimate(
    pad: Pad, tracking: TrackingModel, overlap: Overlap
) -> None:
    """Each measurement is changed by its lasting deviation, one after the other, and solved again."""
    state, field = pressed_field(pad)
    deviation, lasting = deviations(np.random.default_rng(1))
    prior = Prior(state, np.diag(np.where(tracking.initial > 0.0, tracking.initial, 1e-12)))

    def solved(measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        start = prior if tracking.has_prior else None
        estimate = solve(
            measured, pad, state, deviation_t=deviation, parts=tracking.parts, prior=start, stop_chi2=STOP_CONVERGED
        )
        return estimate.state.step_from(state)[:5], estimate.covariance

    here, covariance = solved(field)
    spread = np.zeros((5, 5))
    for axis in range(12):
        error = np.zeros(12)
        error[axis] = 0.01 * lasting.ravel()[axis]  # a small one: the solver is not linear
        moved = (solved(field + error.reshape(4, 3))[0] - here) / 0.01
        spread += np.outer(moved, moved)
    found = overlap(pad, state, covariance, tracking.parts, deviation, lasting)
    scale = np.sqrt(np.diagonal(spread))
    np.testing.assert_allclose(found / scale / scale[:, None], spread / scale / scale[:, None], atol=2e-3)


@SCENES
def test_reduced_covariance_has_no_negative_variance(pad: Pad, tracking: TrackingModel, overlap: Overlap) -> None:
    """However much of the deviations lasts: also if the noise is a ten-thousandth of them."""
    state, field = pressed_field(pad)
    for seed, noise in enumerate((1.0, 1e-2, 1e-4)):
        deviation, lasting = deviations(np.random.default_rng(seed))
        deviation = np.hypot(noise * NOISE_T, lasting)
        prior = Prior(state, np.diag(np.where(tracking.initial > 0.0, tracking.initial, 1e-12)))
        estimate = solve(field, pad, state, deviation_t=deviation, parts=tracking.parts, prior=prior)
        counted = overlap(pad, state, estimate.covariance, tracking.parts, deviation, lasting)
        left = estimate.covariance[:5, :5] - counted
        scale = np.sqrt(np.diagonal(left))
        assert np.linalg.eigvalsh(left / scale / scale[:, None]).min() > 0.0
        assert (np.diagonal(counted) > 0.0).all()
        considered = tracking.parts[LOG_MOMENT] == Part.CONSIDERED
        if considered:  # the considered part stays, although lasting errors are almost all of the rest
            of_moment = estimate.covariance[:5, LOG_MOMENT] ** 2 / estimate.covariance[LOG_MOMENT, LOG_MOMENT]
            assert (np.diagonal(left) > of_moment).all()


def test_pose_in_another_field_scatters_as_stated(pad: Pad, overlap: Overlap) -> None:
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
        lasting = lasting_deviation_t(mounting, pad, field, turned)
        deviation, mounted = np.hypot(NOISE_T, lasting), mounting.mounted(pad)
        estimate = solve(field, mounted, mounting.rest, deviation_t=deviation, free=FREE_FIELD)
        truth = change_since(world.rest, world.rest.stepped(PRESS))[:5]
        change, spread = change_since(mounting.rest, estimate.state)[:5], np.eye(5)
        spread[3:, 3:] = tangent_basis(mounting.rest.axis).T @ tangent_basis(estimate.axis)
        covariance = spread @ estimate.covariance[:5, :5] @ spread.T
        error = np.tensordot(change_since(mounting.rest, estimate.state), mounting.change_error(FREE_FIELD), axes=1)
        cylinder = np.diag(np.array([2e-6, 2e-6, 2e-6, 2e-4, 2e-4]) ** 2)  # the tracker's dipole: see test_baseline.py
        parts = np.where(np.isin(np.arange(14), FREE_FIELD), Part.FREE, Part.FIXED).astype(np.uint8)
        counted = overlap(mounted, estimate.state, estimate.covariance, parts, deviation, lasting)
        for found, own in ((once, covariance - counted), (twice, covariance)):
            off = change - truth
            found.append(off @ np.linalg.solve(own + error @ error.T + cylinder, off))
    # A mean of 60 χ²₅ has a deviation of 0.41.
    assert 5.0 - 4 * 0.41 < np.mean(once) < 5.0 + 4 * 0.41
    assert np.mean(twice) < 5.0 - 4 * 0.41
