"""`baseline --turn`: gains and rotations of the chips, from an unloaded robot that is turned in the Earth's field."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mounted_world import TOLERANCE, World, frames_of, turned

from fmfts import baseline as baselines
from fmfts.baseline import BaselineError, make_bare, make_rest, make_turn, means
from fmfts.baseline.file_format import StoredTurn
from fmfts.baseline.job import BaselineJob
from fmfts.baseline.request import BaselineRequest
from fmfts.baseline.sensitivity import Sensitivity, matrices, relative_deviation
from fmfts.baseline.turn import Turn, sensitivity_from_turn
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Pad, Tolerance
from fmfts.pose import FREE_FIELD, solve
from fmfts.pose.change import change_since
from fmfts.sensor.chips import NOISE_T
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.source import Simulated

UNTESTED = replace(TOLERANCE, gain=0.05)
GAINS_KNOWN = replace(TOLERANCE, sensor_rotation_rad=math.radians(1.5), cross_axis=0.002)
HAND_PLACED = replace(UNTESTED, sensor_rotation_rad=math.radians(1.5), cross_axis=0.002)


@dataclass(frozen=True)
class Turns:
    """Twenty pads within a tolerance, each turned once."""

    tolerance: Tolerance
    each: list[tuple[World, Turn]]


def _world(pad: Pad, seed: int, tolerance: Tolerance = UNTESTED) -> World:
    world = World(pad, np.random.default_rng(seed))
    world.spoilt(tolerance)
    return world


@pytest.fixture(
    scope="module",
    params=[pytest.param(UNTESTED, id="gains", marks=pytest.mark.long), pytest.param(HAND_PLACED, id="hand-placed")],
)
def turns(request: pytest.FixtureRequest) -> Turns:
    pad = PadConfig(name="standard", source=SimulatedSource()).pad()
    worlds = [_world(pad, seed, request.param) for seed in range(20)]
    return Turns(request.param, [(world, Turn.of(turned(world))) for world in worlds])


@pytest.mark.long
def test_errors_of_sensitivities_agree_with_deviations(turns: Turns) -> None:
    errors, deviations, normalised = [], [], []
    for world, turn in turns.each:
        found = sensitivity_from_turn(world.pad, Sensitivity.untested(4, turns.tolerance), turn)
        error = matrices(found.mean) - world.matrices()
        gains = np.einsum("iaa->ia", error)
        turned_by = (error - error.transpose(0, 2, 1)) / 2.0
        # A common factor and a common rotation stay unknown.
        error = error - gains.mean() * np.eye(3) - turned_by.mean(axis=0)
        errors.append(error)
        deviations.append(relative_deviation(found.covariance))
        of_gains = gains.ravel()
        normalised.append(of_gains @ np.linalg.solve(found.covariance[:12, :12], of_gains))
    reached, claimed = (np.sqrt(np.mean(np.square(each), axis=(0, 1))) for each in (errors, deviations))
    # From 5 %: the ratios between x, y and z stay uncertain by this in a workshop's field, which is uneven by half a
    # percent. From 1.5° (0.026): a difference of the field between sensors of 50 nT in 50 µT, in some ten independent
    # directions.
    own = np.eye(3, dtype=bool)
    assert np.sqrt(np.mean(np.square(reached[own]))) < 0.007
    assert reached[~own].max() < 0.003
    named = claimed > 1e-6
    assert claimed[named] == pytest.approx(reached[named], rel=0.5)
    # The mean of 20 χ²₁₂ has a deviation of 1.1.
    assert 12.0 - 4 * 1.1 < np.mean(normalised) < 12.0 + 4 * 1.1


def test_rest_is_known_better_after_a_turn(turns: Turns) -> None:
    """A turn removes the error of a press through gains of ±5 %; the rest agrees with its deviation."""
    normalised = []
    for world, turn in turns.each:
        before = world.baseline(turns.tolerance)
        after = msgspec.structs.replace(before, turn=StoredTurn.of(turn))
        mountings = [one.mounting(world.pad) for one in (before, after)]
        was, now = (baselines.accuracy(one, world.pad) for one in mountings)
        # The depth also depends on the places, which a turn does not measure.
        assert now["press_1n_sideways_sd_m"] < 0.5 * was["press_1n_sideways_sd_m"]
        assert now["press_1n_force_sd_n"] < was["press_1n_force_sd_n"]
        assert now["gain_sd"] < 0.4 * was["gain_sd"]
        normalised.append(_press_error(world, mountings[1]))
    # The mean of 20 χ²₅ has a deviation of 0.7.
    assert np.mean(normalised) < 5.0 + 4 * 0.7


def _press_error(world: World, mounting: baselines.Mounting) -> float:
    """χ²₅ of a press's change of pose, in the deviations that the baseline leaves."""
    press = np.array([3e-4, -2e-4, -7e-4, 0.08, 0.05, 0, 0, 0, 0])
    pressed = world.rest.stepped(press)
    field = mounting.magnet_field(world.field(pressed))
    estimate = solve(field, mounting.mounted(world.pad), mounting.rest, free=FREE_FIELD)
    change = change_since(mounting.rest, estimate.state)[:5]
    truth = change_since(world.rest, pressed)[:5]
    left_open = np.tensordot(change_since(mounting.rest, estimate.state), mounting.change_error(FREE_FIELD), axes=1)
    # The dipole instead of the cylinder, as in test_baseline.
    covariance = left_open @ left_open.T + np.diag(np.array([2e-6, 2e-6, 2e-6, 2e-4, 2e-4]) ** 2)
    return float((change - truth) @ np.linalg.solve(covariance, change - truth))


def test_turn_about_one_axis_is_refused_with_angle_missing(pad: Pad) -> None:
    world = _world(pad, 3)
    with pytest.raises(BaselineError, match=r"not turned about enough axes.*at least 60° \(now \d+°\)"):
        make_turn(pad, turned(world, about=0.1), world.baseline(UNTESTED))


def test_turn_of_standing_robot_is_refused(pad: Pad) -> None:
    world = _world(pad, 3)
    still = means(frames_of(lambda times_s: np.broadcast_to(world.field(), (len(times_s), 4, 3)), 4.0, world.random))
    with pytest.raises(BaselineError, match=r"the robot did not turn: the field moved by 0\.0\d G only.*begin again"):
        make_turn(pad, still, world.baseline(UNTESTED))


def test_touch_while_turning_is_refused_with_its_time(pad: Pad) -> None:
    world = _world(pad, 3)
    with pytest.raises(BaselineError, match=r"disagree by \d+.* mG.* [89]\.\d s after the start.*untouched"):
        make_turn(pad, turned(world, touched=True), world.baseline(UNTESTED))


def test_chip_whose_offset_jumps_while_turning_is_named_and_no_touch(pad: Pad) -> None:
    """By 10 mG, as after a field that is too strong for it. Late in the turn, too, if few orientations show it."""
    world = _world(pad, 4, HAND_PLACED)
    means = turned(world)
    for share in (0.2, 0.9):
        field_t = means.field_t.copy()
        field_t[round(share * len(field_t)) :, 2] += [1e-6, -6e-7, 8e-7]
        with pytest.raises(
            BaselineError, match=r"sensor 3 alone does not see .*offset jumped, .* run selftest"
        ) as told:
            make_turn(pad, replace(means, field_t=field_t), world.baseline(HAND_PLACED))
        assert "touched" not in str(told.value)


def test_flipped_bit_while_turning_is_no_touch(pad: Pad) -> None:
    """64 counts in one of the eleven frames of a mean."""
    world = _world(pad, 5, HAND_PLACED)
    means = turned(world)
    field_t = means.field_t.copy()
    field_t[::20, 0, 1] += 64 / 660 * 1e-4 / 11
    with pytest.raises(BaselineError, match=r"sensor 1 alone does not see .* bits of its readings flip"):
        make_turn(pad, replace(means, field_t=field_t), world.baseline(HAND_PLACED))


@pytest.mark.parametrize(
    ("tolerance", "share", "said"),
    [
        (HAND_PLACED, 0.06, "the turn contradicts the rest"),
        (GAINS_KNOWN, 0.08, r"stronger and weaker by \d\.\d %.*attitude"),
    ],
)
def test_steel_in_the_mount_that_turns_along_is_named(pad: Pad, tolerance: Tolerance, share: float, said: str) -> None:
    """Uncertain gains absorb it, and then the magnet does not fit; known gains leave it in the strength."""
    world = _world(pad, 9, tolerance)
    with pytest.raises(BaselineError, match=said + ".*Steel turns with the pad"):
        make_turn(pad, turned(world, soft_iron=share), world.baseline(tolerance))


@pytest.mark.long
@pytest.mark.parametrize(("share", "least", "most"), [(0.0, 0, 0), (0.08, 48, 50)])
def test_every_board_with_steel_and_no_other_is_refused(pad: Pad, share: float, least: int, most: int) -> None:
    """Turned a little further than needed, because steel must not remove an axis of the sweep, which is another
    cause."""
    said = []
    for seed in range(50):
        world = _world(pad, 1000 + seed, GAINS_KNOWN)
        try:
            make_turn(pad, turned(world, about=1.2, soft_iron=share), world.baseline(GAINS_KNOWN))
        except BaselineError as error:
            said.append(str(error))
    assert all("Steel turns with the pad" in sentence for sentence in said)
    assert least <= len(said) <= most


def test_pad_that_is_waved_is_as_good_as_one_that_is_turned(pad: Pad) -> None:
    """16 rad/s: means of eleven frames would be up to 2.5 % too short, and look like steel."""
    errors = []
    for seed in range(5):
        world = _world(pad, seed)
        means = turned(world, speed=8.0)
        assert means.mean_of < 8
        assert means.noise_t == pytest.approx(NOISE_T, rel=0.25)
        found = sensitivity_from_turn(pad, Sensitivity.untested(4, UNTESTED), Turn.of(means))
        gains = np.einsum("iaa->ia", matrices(found.mean) - world.matrices())
        errors.append(gains - gains.mean())
    assert np.std(errors) < 0.007  # as in a slow turn


def test_noise_is_not_taken_for_steel(pad: Pad) -> None:
    """MLX90393 at their fastest make 2.5 µT: of half a gauss, the strength of four chips' field differs by 2 %."""
    world = _world(pad, 1, GAINS_KNOWN)
    make_turn(pad, turned(world, speed=8.0, noise_t=2.5e-6), world.baseline(GAINS_KNOWN))


def test_turn_needs_a_rest_baseline(pad: Pad) -> None:
    world = _world(pad, 3)
    bare = make_bare(pad, UNTESTED, world.recorded(world.bare()))
    for before in (None, bare):
        with pytest.raises(BaselineError, match=r"--rest.*then --turn"):
            make_turn(pad, turned(world), before)


def test_turn_without_rest_baseline_is_refused_at_once(pad: Pad) -> None:
    request = BaselineRequest(pad, UNTESTED, bare=False, replaced=False, turn=True)
    source = Simulated(PadConfig(name=pad.name, source=SimulatedSource()))
    with ThreadPoolExecutor(1) as executor, pytest.raises(BaselineError, match=r"pad 'standard'.*--rest.*then --turn"):
        BaselineJob(request, None, source, executor)


def test_gains_outlive_the_pad_that_was_turned(pad: Pad) -> None:
    """They belong to the sensors: another pad, and even another bare recording, keep them."""
    world = _world(pad, 4)
    turned_baseline, _ = make_turn(pad, turned(world), world.baseline(UNTESTED))
    bare = make_bare(pad, UNTESTED, world.recorded(world.bare()), turned_baseline)
    rest, mounting = make_rest(pad, UNTESTED, world.recorded(world.field()), bare, replaced=True)
    assert rest.turn == turned_baseline.turn is not None
    assert baselines.accuracy(mounting, pad)["gain_sd"] < 0.01


def test_file_with_a_turn_comes_back_the_same(pad: Pad, tmp_path: Path) -> None:
    world = _world(pad, 5)
    baseline, mounting = make_turn(pad, turned(world), world.baseline(UNTESTED))
    path = tmp_path / "standard.json"
    path.write_bytes(baselines.encode(baseline))
    loaded = baselines.load(path, pad)
    assert loaded == baseline
    assert loaded is not None
    assert (loaded.mounting(pad).gain == mounting.gain).all()


def test_simulated_pad_tumbles_for_its_turn() -> None:
    """As `fmfts-daemon baseline --turn` does without a daemon, in the source's own fast time."""
    config = PadConfig(name="demo", source=SimulatedSource(finger="none"))
    source = Simulated(config)
    source.tumbling = True
    frames = [frame for step in range(20 * 220) for frame in source.poll(round(step * 1e9 / 220))]
    request = BaselineRequest(config.pad(), UNTESTED, bare=False, replaced=False, turn=True)
    assert request.seconds == 20.0
    _, mounting = request.make(frames, simulated_baseline(config))
    assert baselines.accuracy(mounting, config.pad())["gain_sd"] < 0.01


def test_one_kind_of_baseline_at_a_time(pad: Pad) -> None:
    with pytest.raises(BaselineError, match="one of bare, turn, refine, learn, posture and weigh at a time"):
        BaselineRequest(pad, UNTESTED, bare=False, replaced=False, turn=True, refine=True)


@pytest.mark.parametrize("nonsense", ["a magnet passes", "noise alone", "half of it lost"])
def test_impossible_turn_is_refused_or_solved_without_internal_error(nonsense: str, pad: Pad) -> None:
    """Fields that are impossible for any pad lead to equations without a solution: the turn's error says so."""
    random = np.random.default_rng(5)
    refused = 0
    for seed in range(6):
        world = _world(pad, seed)
        fields = turned(world)
        if nonsense == "a magnet passes":
            fields.field_t[random.integers(0, len(fields.field_t), 5)] *= 1e3
        elif nonsense == "noise alone":
            fields.field_t[:] = random.normal(0.0, 1e-4, fields.field_t.shape)
        else:
            fields.field_t[: len(fields.field_t) // 2] = 0.0
        try:
            make_turn(pad, fields, world.baseline(UNTESTED))
        except BaselineError:
            refused += 1
    assert refused or nonsense == "half of it lost"
