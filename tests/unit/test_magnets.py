"""Several magnets in one pad: their field, its slopes, and the baseline that finds where they rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmfts.baseline import BaselineError
from fmfts.baseline.array_mounting import estimate_array_mounting, moved_since
from fmfts.baseline.recording import Recording
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.pad import Array, SensorArray
from fmfts.pose import dipole_field
from fmfts.pose.magnets import CHANGE, Magnets, field_and_slope, field_of, rest_frames, sum_of_fields
from fmfts_lab.bench.several_world import BUILT, BY_HAND, NOISE_T, world
from fmfts_lab.finite_elements.array_pad import array_config

PAD = array_config().pad()
DRAWN = Magnets.drawn(PAD)
FRAMES = rest_frames(DRAWN.axis)


def a_change(seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(size=20) * np.tile([3e-4, 3e-4, 5e-4, 0.05, 0.05], 4)


def recording(field_t: Array) -> Recording:
    count = len(field_t)
    return Recording(field_t, np.full(field_t.shape, NOISE_T), np.full(count, 660), 0, 25.0, 3.0)


def test_field_is_the_sum_of_the_magnets_fields() -> None:
    alone = [
        dipole_field(PAD.sensors.position_m, one.rest_position_m, one.rest_axis, one.magnet.strength_t_m3, 2.5e-7)
        for one in PAD.magnets
    ]
    assert np.allclose(sum_of_fields(DRAWN, PAD.sensors.position_m), np.sum(alone, axis=0), rtol=1e-12)


def test_magnet_that_points_down_tilts_like_one_that_points_up() -> None:
    """Mechanics know no polarity: the same change turns the axis of each towards the same side."""
    moved = DRAWN.changed(np.tile([0.0, 0.0, 0.0, 0.1, 0.02], 4), FRAMES)
    upright = moved.axis * np.sign(DRAWN.axis[:, 2:])
    assert np.allclose(upright[:, :2], [[0.1, 0.02]] * 4)


def test_slopes_are_the_field_s_differences() -> None:
    turned = SensorArray(PAD.sensors.position_m, np.array([np.diag([1.0, -1.0, -1.0])] * 8))
    change, step = a_change(), np.tile([1e-7, 1e-7, 1e-7, 1e-5, 1e-5], 4)
    field, slope = field_and_slope(DRAWN.changed(change, FRAMES), FRAMES, turned)
    assert np.allclose(field, field_of(DRAWN.changed(change, FRAMES), turned), atol=1e-15)
    for column in range(20):
        one = np.zeros(20)
        one[column] = step[column]
        more, less = (field_of(DRAWN.changed(change + sign * one, FRAMES), turned) for sign in (1.0, -1.0))
        difference = (more - less).ravel() / (2.0 * step[column])
        assert np.allclose(slope[:, column], difference, rtol=1e-4, atol=1e-5 * np.abs(difference).max())


@pytest.mark.long
@pytest.mark.parametrize(("tolerance", "honest"), [(BUILT, 1.25), (BY_HAND, 1.35)])
def test_baselines_uncertainty_matches_the_errors_it_causes(tolerance: object, honest: float) -> None:
    """Of thirty built pads the rms of error over deviation is one; the causes that are kept leave out a little."""
    ratios = []
    for seed in range(30):
        one = world(seed, tolerance)  # type: ignore[arg-type]
        change = a_change(seed)
        true = one.gain * (
            field_of(one.magnets.changed(change, one.frames), one.sensors) - field_of(one.magnets, one.sensors)
        )
        mounting = one.mounting
        told = field_of(mounting.magnets.changed(change, mounting.frames), mounting.sensors) - mounting.rest_field_t
        deviation = np.sqrt(np.square(mounting.errors.at(change, np.zeros(3))).sum(axis=1))
        ratios.append((true / mounting.gain - told).ravel() / deviation)
    rms = float(np.sqrt(np.mean(np.square(ratios))))
    assert 1.0 / honest < rms < honest


def test_baseline_finds_stronger_magnets() -> None:
    """Three deviations of a remanence that was not known to better than 1 %: that of the estimate, 0.6 to 1 %."""
    stronger = DRAWN.stronger(np.array([0.02, -0.02, 0.01, 0.0]))
    known = Sensitivity.untested(8, BUILT)
    mounting = estimate_array_mounting(
        PAD, replace(BUILT, remanence=0.02), recording(field_of(stronger, PAD.sensors)), None, known
    )
    deviation = np.sqrt(np.diagonal(mounting.rest_covariance)).reshape(-1, 6)[:, 5]
    assert (np.abs(mounting.log_moment - [0.02, -0.02, 0.01, 0.0]) < 3.0 * deviation).all()
    assert deviation.max() < 0.02
    assert mounting.remanences_t(PAD)[0] > mounting.remanences_t(PAD)[1]


@pytest.mark.parametrize("wrong", ["missing", "upside down"])
def test_pad_with_a_magnet_missing_or_upside_down_is_refused(wrong: str) -> None:
    axis, strength = DRAWN.axis.copy(), DRAWN.strength_t_m3.copy()
    if wrong == "missing":
        strength[2] = 0.0
    else:
        axis[2] *= -1.0
    field_t = field_of(replace(DRAWN, axis=axis, strength_t_m3=strength), PAD.sensors)
    with pytest.raises(BaselineError, match=r"does not fit an unloaded pad.*missing or upside down"):
        estimate_array_mounting(PAD, BY_HAND, recording(field_t), None, Sensitivity.untested(8, BY_HAND))


def test_baseline_under_load_names_the_magnet_that_moved_most() -> None:
    one = world(3, BUILT)
    change = np.zeros((4, CHANGE))
    change[1, 2] = -4e-4
    loaded = one.gain * field_of(one.magnets.changed(change.ravel(), one.frames), one.sensors)
    ambient = one.gain * one.sensors.to_sensor(np.tile(one.ambient_t + 3e-6, (8, 1)))
    moved, around = moved_since(one.mounting, recording(loaded + ambient))
    assert np.abs(moved - [0.0, 0.0, -4e-4]).max() < 5e-5  # an eighth of the change: gains of half a percent, and noise
    assert np.abs(around - 3e-6).max() < 1e-6  # gains of half a percent of what the press changes, 200 µT
    still, around = moved_since(one.mounting, recording(one.gain * field_of(one.magnets, one.sensors) + ambient))
    assert np.abs(around - 3e-6).max() < 2e-7  # noise, and gains and turns of a percent
    assert np.abs(still).max() < 2e-5
