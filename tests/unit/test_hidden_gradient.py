"""A foreign field whose gradient looks like a press: its uniform part betrays it, and deviations count it."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from mounted_world import TOLERANCE, World
from test_pipeline import config_of

from fmfts.baseline import make_bare, make_rest
from fmfts.config import SceneConfig
from fmfts.pad import Pad, rotation_from_vector
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts.pose import FREE_FIELD, SensorErrors, TrackingModel, dipole_field, parts_of, solve
from fmfts.pose._alignment import VAGUE_M
from fmfts.pose.change import change_since
from fmfts.pose.hidden_gradient import (
    EVEN_T,
    GRADIENT_PER_T,
    HEALTHY,
    IRON_T,
    STANDS_STILL,
    HiddenGradient,
    Reference,
    effect_of_gradient,
    reference_of,
)
from fmfts.pose.state import AMBIENT, State
from fmfts_lab.bench.field_tracker import FieldTracker, Tracked
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.tool_ways import WAYS, Tool
from fmfts_lab.bench.tools import BesideTool, Scene, baseline_of, drilled, pad_config

EARTH_T = np.array([2e-5, -1e-5, -4.5e-5])
NOISE_T = np.full((4, 3), 2e-7)
MEASURED = Reference(EARTH_T, 0.0)


@pytest.fixture
def pad() -> Pad:
    return config_of().pad()


FADES_S = 1.0  # hidden_gradient.c: a detected change fades in this time


def hidden_of(pad: Pad, reference: Reference = MEASURED) -> HiddenGradient:
    effect = effect_of_gradient(pad, State.at_rest(pad), NOISE_T, FREE_FIELD)
    return HiddenGradient(pad, State.at_rest(pad), reference, np.zeros((8, 3, 0)), effect)


class Follower:
    """An untouched pad whose ambient field changes after its baseline. It judges fields without noise."""

    def __init__(self, pad: Pad, reference: Reference = MEASURED) -> None:
        self.hidden = hidden_of(pad, reference)
        model, errors = TrackingModel(parts_of(free=FREE_FIELD)), SensorErrors(NOISE_T)
        self._field_t, self._pad = own_field_t(pad), pad
        self._tracker = FieldTracker(pad, State.at_rest(pad), model, 25.0, errors, self.hidden)

    def judge(self, change_t: np.ndarray, elapsed_s: float = 5e-3) -> Tracked:
        field_t = self._pad.sensors.to_sensor(self._field_t + change_t)
        return self._tracker.update(field_t, NOISE_T, elapsed_s, 25.0)

    @property
    def foreign_t(self) -> float:
        return self._tracker.memory.number("foreign_t")


def own_field_t(pad: Pad) -> np.ndarray:
    rest, magnet = State.at_rest(pad), pad.magnet
    places, octupole_m2 = pad.sensors.position_m, magnet.modelled_octupole_m2
    return dipole_field(places, rest.position_m, rest.axis, magnet.strength_t_m3, octupole_m2)


def healthy(pad: Pad) -> tuple[float, np.ndarray]:
    """Deviation (m) of a resting magnet's height, and covariance (3, 3) of the ambient field."""
    estimate = solve(own_field_t(pad), pad, State.at_rest(pad), deviation_t=NOISE_T, free=FREE_FIELD)
    return float(np.sqrt(estimate.covariance[2, 2])), estimate.covariance[AMBIENT, AMBIENT]


def height_sd_m(tracked: Tracked) -> float:
    assert tracked.estimate is not None
    return float(np.sqrt(tracked.estimate.covariance[2, 2]))


def test_gradient_effect_matches_the_solvers_error(pad: Pad) -> None:
    rest = State.at_rest(pad)
    effect = effect_of_gradient(pad, rest, NOISE_T, FREE_FIELD)
    for component, (row, column) in enumerate([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2)]):
        gradient = np.zeros((3, 3))
        gradient[row, column] = gradient[column, row] = 1e-5
        gradient[2, 2] -= gradient[0, 0] + gradient[1, 1]
        field_t = own_field_t(pad) + pad.sensors.position_m @ gradient
        estimate = solve(field_t, pad, rest, deviation_t=NOISE_T, free=FREE_FIELD)
        moved = change_since(rest, estimate.state)[:5]
        expected = effect[:, component] * 1e-5
        assert moved == pytest.approx(expected, abs=0.02 * np.abs(expected).max() + 1e-9)


def test_earth_s_field_that_turns_adds_nothing(pad: Pad) -> None:
    gradient, random = Follower(pad), np.random.default_rng(1)
    for _ in range(50):
        turned = rotation_from_vector(random.normal(0.0, 1.0, 3)) @ EARTH_T * random.normal(1.0, 0.005)
        assert height_sd_m(gradient.judge(turned - EARTH_T)) == pytest.approx(healthy(pad)[0], rel=1e-6)
    assert gradient.foreign_t == 0.0


def test_stronger_field_adds_the_gradient_of_a_dipole_60_mm_away(pad: Pad) -> None:
    gradient, foreign_t = Follower(pad), 1e-5
    told = gradient.judge(EARTH_T / np.linalg.norm(EARTH_T) * foreign_t)
    assert told.health == "ok"
    unit = EARTH_T / np.linalg.norm(EARTH_T)
    alone_m, covariance = healthy(pad)
    seen_t = np.sqrt(foreign_t**2 - HEALTHY**2 * (EVEN_T**2 + unit @ covariance @ unit))
    assert gradient.foreign_t == pytest.approx(seen_t, rel=1e-6)
    effect = effect_of_gradient(pad, State.at_rest(pad), NOISE_T, FREE_FIELD)
    added = GRADIENT_PER_T * seen_t * np.linalg.norm(effect[2])
    assert height_sd_m(told) == pytest.approx(np.hypot(alone_m, added), rel=1e-5)
    assert pytest.approx(3.0 / 0.06) == GRADIENT_PER_T


def test_hidden_field_fades_gradually(pad: Pad) -> None:
    gradient, unit = Follower(pad), EARTH_T / np.linalg.norm(EARTH_T)
    first = height_sd_m(gradient.judge(1e-5 * unit))
    at_once = height_sd_m(gradient.judge(np.zeros(3)))
    assert first > at_once > 0.99 * first
    for _ in range(round(10 * FADES_S / 5e-3)):
        later = height_sd_m(gradient.judge(np.zeros(3)))
    assert later < 1.01 * healthy(pad)[0]


def test_turned_field_is_foreign_on_a_standing_robot(pad: Pad) -> None:
    turned = rotation_from_vector(np.array([0.0, 0.1, 0.0])) @ EARTH_T - EARTH_T
    assert Follower(pad).judge(turned).estimate is not None
    still = Follower(pad, STANDS_STILL)
    still.judge(turned)
    assert still.foreign_t == pytest.approx(np.linalg.norm(turned), rel=0.1)


def test_gradient_worth_a_millimetre_is_disturbed(pad: Pad) -> None:
    gradient, unit = Follower(pad), EARTH_T / np.linalg.norm(EARTH_T)
    for share, reason in ((0.6, "60% stronger"), (-0.6, "60% weaker")):
        told = gradient.judge(share * np.linalg.norm(EARTH_T) * unit)
        assert (told.health, told.estimate) == ("disturbed", None)
        assert reason in told.reason
    effect = effect_of_gradient(pad, State.at_rest(pad), NOISE_T, FREE_FIELD)
    assert gradient.hidden.strongest_t * GRADIENT_PER_T * np.linalg.norm(effect[:3]) == pytest.approx(VAGUE_M)


def test_foreign_field_is_not_judged_without_bare_turn_recording(pad: Pad) -> None:
    gradient = Follower(pad, reference_of(pad, None, None))
    assert height_sd_m(gradient.judge(4e-5 * np.array([0.6, 0.0, 0.8]))) == pytest.approx(healthy(pad)[0], rel=1e-6)
    assert gradient.foreign_t == 0.0


def test_magnet_that_turns_along_is_not_an_approaching_one(pad: Pad) -> None:
    """A motor beside the pad: the ambient field's strength changes as the robot turns, by up to twice the motor's."""
    iron_t, random = np.array([6e-6, -4e-6, 5e-6]), np.random.default_rng(2)
    turns = [rotation_from_vector(random.normal(0.0, 1.5, 3)) for _ in range(100)]
    here_t = np.tile(EARTH_T + iron_t, (4, 1))
    turned_t = np.array([np.tile(turn @ EARTH_T + iron_t, (4, 1)) for turn in turns])
    assert reference_of(pad, here_t, turned_t).field_t == pytest.approx(EARTH_T, abs=1e-9)
    for reference in (reference_of(pad, here_t, None), reference_of(pad, here_t, turned_t)):
        gradient = Follower(pad, reference)
        for turn in turns:
            gradient.judge(turn @ EARTH_T - EARTH_T)
            assert gradient.foreign_t == 0.0
    # Without the turn it would count as a foreign field.
    naive, found_t = Follower(pad, Reference(EARTH_T + iron_t, 0.0)), 0.0
    for turn in turns:
        naive.judge(turn @ EARTH_T - EARTH_T)
        found_t = max(found_t, naive.foreign_t)
    assert found_t > 5e-6


@pytest.mark.parametrize("gain", [0.005, 0.05])
def test_ambient_field_scatters_as_stated(pad: Pad, gain: float) -> None:
    """Chips that are off read a press and another ambient field as a foreign one; the baseline says by how much."""
    normalised = []
    for seed in range(40):
        world, tolerance = World(pad, np.random.default_rng(seed)), replace(TOLERANCE, gain=gain)
        world.spoilt(tolerance)
        before = make_bare(pad, tolerance, world.recorded(world.bare()))
        _, mounting = make_rest(pad, tolerance, world.recorded(world.field()), before)
        turned_t = np.array([3e-5, -4e-5, 2e-5])
        world.earth_t = world.earth_t + turned_t
        press = np.array([3e-4, -2e-4, -7e-4, 0.08, 0.05, 0, 0, 0, 0])
        field = mounting.magnet_field(world.field(world.rest.stepped(press)))
        estimate = solve(field, mounting.mounted(pad), mounting.rest, free=FREE_FIELD)
        error = estimate.state.ambient_t - turned_t
        since = change_since(mounting.rest, estimate.state)
        left_open = np.tensordot(since, mounting.ambient_error(FREE_FIELD), axes=1)
        covariance = left_open @ left_open.T + np.eye(3) * (1e-7) ** 2
        normalised.append(error @ np.linalg.solve(covariance, error))
    # A mean of 40 χ²₃ has a deviation of 0.39.
    assert 3.0 - 4 * 0.39 < np.mean(normalised) < 3.0 + 4 * 0.39


def test_hidden_field_leaves_the_earths_strength(pad: Pad) -> None:
    """It is at a right angle to the Earth's; what a robot that was never turned carries hides a larger one."""
    measured, unmeasured = hidden_of(pad), hidden_of(pad, Reference(EARTH_T, IRON_T))
    across = np.cross(EARTH_T, [0.0, 0.0, 1.0])
    beside_t = EARTH_T + measured.unseen_t * across / np.linalg.norm(across)
    assert np.linalg.norm(beside_t) - np.linalg.norm(EARTH_T) == pytest.approx(HEALTHY * EVEN_T)
    assert measured.unseen_t < unmeasured.unseen_t == unmeasured.strongest_t
    assert hidden_of(pad, STANDS_STILL).unseen_t == pytest.approx(HEALTHY * EVEN_T)
    assert hidden_of(pad, reference_of(pad, None, None)).unseen_t == unmeasured.strongest_t


# Two passing tools that looked like contacts: one of 6.6 N without one sensor, one of 0.04 N in 82 frames.
@pytest.mark.parametrize(("way", "seed"), [(0, 1), (2, 7)])
def test_tool_beside_a_turned_pad_is_no_contact(way: int, seed: int) -> None:
    config, passing = pad_config("turned", 1, "drawn"), WAYS[way]
    config = msgspec.structs.replace(config, scene=SceneConfig(steel_nearby=True))
    pipeline = without_baseline(config, load_contact_model(config))
    pipeline.use(baseline_of(pad_config("turned", 1, "drawn"), "turned"))
    source = BesideTool(config, Tool(passing, 0.02, np.random.default_rng(seed)))
    answers = [pipeline.answer(frame) for batch in source.batches(round(passing.seconds * 220)) for frame in batch]
    messages = [message_of(answer) for answer in answers]
    assert not any(message.contact for message in messages)
    assert sum(message.health == "ok" for message in messages) > 0.5 * len(messages)


# A path of `bench tools` on which a third of the frames reported a contact where there was none.
PUT_DOWN, MOMENT_A_M2 = WAYS[8], 0.055


@pytest.mark.parametrize("scene", ["steel", "turned"])
def test_magnetic_tool_is_no_contact_and_no_wrong_answer(scene: Scene) -> None:
    (cell,) = drilled((scene,), (MOMENT_A_M2,), (PUT_DOWN,), ("rest",), range(1, 2), "drawn")
    assert cell.health["ok"] > 1000  # missing answers are not the cause
    assert (cell.wrong, cell.wrong_degraded, cell.false_contacts) == (0, 0, 0), cell.line
