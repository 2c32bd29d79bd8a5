"""`baseline --refine`: sensor places and gains from unlabelled presses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mounted_world import NOISE_T, TOLERANCE, World, frames_of, pressing

from fmfts import baseline as baselines
from fmfts.baseline import BaselineError, Means, Mounting, make_refined, make_rest, means
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Pad
from fmfts.pose import State

SEEDS = range(20)


def _presses(world: World, count: int = 36) -> Means:
    """Averages of steady presses anywhere, as `means` makes them; for many worlds, without their frames."""
    random = world.random
    x_m, y_m = random.uniform(-11e-3, 11e-3, (2, count))
    states = world.pressed(x_m, y_m, random.uniform(0.2, 2.0, count))
    fields = np.array([world.field(state) + world.sensed(world.surroundings()) for state in states])
    noisy = fields + random.normal(0.0, NOISE_T / np.sqrt(11), fields.shape)
    return Means(noisy, np.zeros(count), np.arange(count) * 0.05, np.full((4, 3), NOISE_T))


def _error(world: World, mounting: Mounting) -> tuple[np.ndarray, np.ndarray]:
    """The error of rest pose, log moment (6), places (12) and sensitivities (36, or the 12 gains), and its
    covariance.
    """
    leftover = mounting.leftover
    assert leftover is not None
    unknowns = leftover.unknowns
    truth = np.concatenate(
        [
            world.rest.step_from(State.at_rest(world.pad))[:5],
            [np.log(world.remanence_t / 1.23)],
            np.zeros(3),
            (world.places - world.pad.sensors.position_m).ravel(),
            world.values() - unknowns.sensitivity,
        ]
    )
    scale = unknowns.deviation
    known = np.setdiff1d(np.flatnonzero(scale), np.r_[6:9])
    covariance = leftover.covariance * scale * scale[:, None]
    return (scale * leftover.scaled - truth)[known], covariance[np.ix_(known, known)]


HAND_PLACED = replace(TOLERANCE, gain=0.05, sensor_rotation_rad=np.radians(1.5), cross_axis=0.002)
TOLERANCES = [
    pytest.param(TOLERANCE, id="0.5 %", marks=pytest.mark.long),
    pytest.param(replace(TOLERANCE, gain=0.05), id="5 %", marks=pytest.mark.long),
    pytest.param(HAND_PLACED, id="hand-placed"),
]


@pytest.fixture(scope="module", params=TOLERANCES)
def refined(request: pytest.FixtureRequest) -> list[tuple[World, Mounting, Mounting]]:
    """World, mounting before and after, for twenty pads."""
    pad = PadConfig(name="standard", source=SimulatedSource()).pad()
    tolerance = request.param
    worlds = []
    for seed in SEEDS:
        world = World(pad, np.random.default_rng(seed))
        world.spoilt(tolerance)
        before = world.baseline(tolerance)
        worlds.append((world, before.mounting(pad), make_refined(pad, _presses(world), before)[1]))
    return worlds


@pytest.mark.parametrize("which", ["at rest", "refined"])
def test_errors_of_refined_unknowns_agree_with_deviations(
    refined: list[tuple[World, Mounting, Mounting]], which: str
) -> None:
    normalised = []
    for world, before, after in refined:
        error, covariance = _error(world, after if which == "refined" else before)
        normalised.append(error @ np.linalg.solve(covariance, error))
    # These worlds are drawn from the priors: the mean of 20 χ²ₙ has a deviation of √(2n/20).
    expected, deviation = len(error), np.sqrt(2.0 * len(error) / len(SEEDS))
    assert expected - 4 * deviation < np.mean(normalised) < expected + 4 * deviation


def test_places_and_gains_are_nearer_to_the_truth(refined: list[tuple[World, Mounting, Mounting]]) -> None:
    squares = np.zeros((2, len(_error(*refined[0][:2])[0])))
    for world, before, after in refined:
        for which, mounting in enumerate((before, after)):
            squares[which] += _error(world, mounting)[0] ** 2
        was, now = (baselines.accuracy(mounting, world.pad) for mounting in (before, after))
        assert now["gain_sd"] < was["gain_sd"]
        assert now["sensor_place_sd_m"] < was["sensor_place_sd_m"]
    assert squares[1, 6:18].sum() < 0.9 * squares[0, 6:18].sum()
    assert squares[1, 18:30].sum() < 0.8 * squares[0, 18:30].sum()


def test_presses_are_picked_from_a_recording(pad: Pad) -> None:
    """Forty seconds of frames from chips on clocks of their own, with rests and ramps between the presses."""
    world = World(pad, np.random.default_rng(2))
    baseline, mounting = make_refined(pad, pressing(world), world.baseline(TOLERANCE))
    assert baseline.refine is not None
    assert 20 <= len(baseline.refine.field_t) <= 40
    error, covariance = _error(world, mounting)
    # χ²₃₀ exceeds 60 once in a thousand.
    assert error @ np.linalg.solve(covariance, error) < 60.0


def test_noise_of_interpolated_means_is_as_stated(pad: Pad) -> None:
    world = World(pad, np.random.default_rng(2))
    field = world.field()
    still = means(frames_of(lambda times_s: np.broadcast_to(field, (len(times_s), 4, 3)), 20.0, world.random))
    normalised = (still.field_t - field) / (still.noise_t / np.sqrt(11))
    # 4800 values: 1 %. Two neighbours that share a mean's outermost sample remove up to 2.3 % of its noise.
    assert 0.94 < np.sqrt(np.mean(normalised**2)) < 1.04


def test_too_few_presses_are_refused_with_their_number(pad: Pad) -> None:
    world = World(pad, np.random.default_rng(2))
    with pytest.raises(BaselineError, match=r"only 8 different presses were found, of at least 15"):
        make_refined(pad, _presses(world, 8), world.baseline(TOLERANCE))


def test_untouched_pad_has_no_presses(pad: Pad) -> None:
    world = World(pad, np.random.default_rng(2))
    noisy = world.field() + world.random.normal(0.0, NOISE_T / np.sqrt(11), (100, 4, 3))
    untouched = Means(noisy, np.zeros(100), np.arange(100) * 0.05, np.full((4, 3), NOISE_T))
    with pytest.raises(BaselineError, match="only 0 different presses"):
        make_refined(pad, untouched, world.baseline(TOLERANCE))


def test_robot_that_turns_meanwhile_is_refused(pad: Pad) -> None:
    world = World(pad, np.random.default_rng(2))
    with pytest.raises(BaselineError, match=r"do not fit one magnet.*hold the robot still"):
        make_refined(pad, pressing(world, robot_rad=1.0), world.baseline(TOLERANCE))


def test_next_rest_recording_keeps_refined_places(pad: Pad) -> None:
    world = World(pad, np.random.default_rng(7))
    before, mounting = make_refined(pad, _presses(world), world.baseline(TOLERANCE))
    same, again = make_rest(pad, TOLERANCE, world.recorded(world.field()), before)
    assert same.refine == before.refine is not None
    assert np.abs(again.sensor_position_m - mounting.sensor_position_m).max() < 5e-5
    other, _ = make_rest(pad, TOLERANCE, world.recorded(world.field()), before, replaced=True)
    assert other.refine is None
