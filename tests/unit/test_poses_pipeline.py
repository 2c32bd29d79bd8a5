"""A pad with several magnets and no table of presses: touch and poses by the field alone, faults, and what it says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fmfts.baseline import Baseline
from fmfts.bus.encoding import decode_contact, encode
from fmfts.bus.frame_message import frame_message
from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig, PadConfig
from fmfts.contact import ModelError, NoContactModel
from fmfts.contact.array_model import ArrayModel
from fmfts.pad import Placement
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.pipeline.snapshot import BadMemoryError, restore, snapshot, state_message
from fmfts.pipeline.words import BARE_ONLY
from fmfts.runtime.announcer import _place
from fmfts.sensor import Frame
from fmfts_lab.bench.several_layouts import LAYOUTS
from fmfts_recording.file import RecordingWriter
from fmfts_recording.replay import Replay, essence
from fmfts_simulation.array import SimulatedArray
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch, no_finger, steady_finger

PERIOD_NS = round(1e9 / 220)
PRESS = steady_finger(-4e-3, -1e-3, 0.8)
LARGEST = pytest.param("4 over 16", marks=pytest.mark.long)
WITHOUT_A_MODEL = ["2 over 8", "3 over 8", "4 over 12", LARGEST]
BASELINES: dict[str, Baseline] = {}


def config_of(name: str, model: str = "none") -> PadConfig:
    config = LAYOUTS[name]
    source = msgspec.structs.replace(config.source, seed=3)
    return msgspec.structs.replace(config, source=source, contact=ContactConfig(model=model))


def ready(name: str, model: str = "none") -> SeveralPipeline:
    config = config_of(name, model)
    made = pipeline_of(config, contact_model_of(config), "boot")
    assert isinstance(made, SeveralPipeline)
    if name not in BASELINES:
        BASELINES[name] = simulated_baseline(config)
    made.use(BASELINES[name])
    return made


def frames(name: str, count: int, *fingers: Finger) -> Iterator[tuple[Frame, np.ndarray]]:
    """Each frame, and where the magnets were (M, 3) when it was sampled."""
    source = SimulatedArray(config_of(name))
    source.finger, source.second_finger = (*fingers, no_finger, no_finger)[:2]
    for step in range(2 * count):
        for frame in source.poll(step * PERIOD_NS):
            if frame.sequence < count:
                touches = [finger(frame.host_time_ns * 1e-9) for finger in (source.finger, source.second_finger)]
                yield frame, source.inside.moved([touches])[0].position_m


def errors(message: ContactMessage, position_m: np.ndarray) -> np.ndarray:
    """(M, 3) of the places of all magnets, in published deviations."""
    assert isinstance(message.poses, list)
    told = np.array([pose.position_m for pose in message.poses])
    deviation = np.array([pose.position_sd_m for pose in message.poses])
    off: np.ndarray = (told - position_m) / deviation
    return off


@pytest.mark.parametrize("name", WITHOUT_A_MODEL)
def test_untouched_pad_reports_its_poses_and_no_touch(name: str) -> None:
    made = ready(name)
    said = [(made.process(frame), position) for frame, position in frames(name, 220)]
    for message, position in said:
        assert (message.health, message.contact, message.contacts, message.more) == ("ok", False, None, False)
        assert message.force_n is None
        assert message.x_m is None
        assert message.reason == (
            'no contact model for this pad: [pad.contact] model is "none"; to get forces, make a table of its presses '
            "(docs/several.md)"
        )
        assert message.model == "none"
        assert np.abs(errors(message, position)).max() < 5.0
    assert decode_contact(encode(said[-1][0])) == said[-1][0]


@pytest.mark.parametrize("name", WITHOUT_A_MODEL)
def test_pressed_pad_reports_touch_poses_and_how_far_its_magnets_moved(name: str) -> None:
    made, rest = ready(name), None
    for frame, position in frames(name, 40, PRESS):
        message = made.process(frame)
        assert (message.health, message.contact) == ("ok", True)
        assert np.abs(errors(message, position)).max() < 5.0
    rest = SimulatedArray(config_of(name)).inside.magnets.position_m
    farthest_m = float(np.linalg.norm(position - rest, axis=1).max())
    assert farthest_m > 3e-4
    assert message.displacement_m is not None
    assert message.displacement_sd_m is not None
    assert abs(message.displacement_m - farthest_m) < 5.0 * message.displacement_sd_m
    assert message.displacement_sd_m < 5e-5
    assert _place(message) == f"the magnet that moved most moved by {1e3 * message.displacement_m:.3f} mm"


def test_touch_ends_when_the_finger_lifts() -> None:
    def lifting(time_s: float) -> Touch:
        return PRESS(time_s) if time_s < 0.1 else Touch(0.0, 0.0, 0.0)

    made = ready("2 over 8")
    said = [made.process(frame).contact for frame, _ in frames("2 over 8", 60, lifting)]
    assert said[15] is True
    assert said[-20:] == [False] * 20


def without(sensor: int) -> Callable[[Frame], Frame]:
    def change(frame: Frame) -> Frame:
        valid = frame.valid.copy()
        valid[sensor] = False
        return replace(frame, valid=valid)

    return change


def off(sensor: int, counts: int) -> Callable[[Frame], Frame]:
    def change(frame: Frame) -> Frame:
        changed = frame.counts.copy()
        changed[sensor, 0] += counts
        return replace(frame, counts=changed)

    return change


@pytest.mark.parametrize("name", WITHOUT_A_MODEL)
def test_silent_sensor_is_named_and_poses_are_right_without_it(name: str) -> None:
    made, mute = ready(name), without(2)
    for frame, position in frames(name, 20, PRESS):
        message = made.process(mute(frame))
        assert message.health == "degraded"
        assert message.reason.startswith("sensor 3 is silent; no contact model")
        assert np.abs(errors(message, position)).max() < 5.0


def test_too_few_sensors_are_lost_with_needed_count() -> None:
    made = ready("3 over 8")
    for frame, _ in frames("3 over 8", 5, PRESS):
        message = made.process(without(1)(without(2)(frame)))
    assert (message.health, message.contact, message.poses) == ("lost", None, None)
    assert message.reason.startswith(
        "only 18 values are left, and the poses of all magnets need 21; sensor 2 is silent"
    )


@pytest.mark.parametrize("name", ["2 over 8", "4 over 12", LARGEST])
@pytest.mark.parametrize("sensor", [0, 5])
def test_contradicting_sensor_is_named_and_excluded_until_it_agrees(name: str, sensor: int) -> None:
    """600 counts are 40 µT."""
    made, lie, healths = ready(name), off(sensor, 600), []
    for frame, position in frames(name, 70, PRESS):
        message = made.process(lie(frame) if 10 <= frame.sequence < 30 else frame)
        healths.append(message.health)
        if message.poses is not None and message.health != "disturbed":
            assert np.abs(errors(message, position)).max() < 5.0
        if 13 <= frame.sequence < 30:
            assert f"sensor {sensor + 1} contradicts all others, and is left out" in message.reason
        assert "stuck" not in message.reason, "of a sensor that is used again"
    assert healths[:10] == ["ok"] * 10
    assert set(healths[12:30]) == {"degraded"}
    assert healths[-1] == "ok"


def test_sensor_that_was_left_out_is_asked_again_where_others_are_too_few() -> None:
    made, lie, mute = ready("3 over 8"), off(0, 1200), without(3)
    for frame, now_m in frames("3 over 8", 40, PRESS):
        position, number = now_m, frame.sequence
        message = made.process(frame if number < 10 else lie(frame) if number < 25 else mute(frame))
        if number == 24:
            assert "sensor 1 contradicts all others" in message.reason
    assert message.health == "degraded"
    assert message.reason.startswith("sensor 4 is silent; no contact model")
    assert np.abs(errors(message, position)).max() < 5.0


@pytest.mark.parametrize("name", WITHOUT_A_MODEL)
def test_foreign_field_is_disturbed_without_poses(name: str) -> None:
    made, random = ready(name), np.random.default_rng(5)
    pattern = random.choice([-140, 140], (len(LAYOUTS[name].geometry.sensors_mm), 3))  # 10 µT
    for frame, _ in frames(name, 20, PRESS):
        message = made.process(replace(frame, counts=frame.counts + pattern.astype(np.int16)))
        assert message.health == "disturbed"
        assert (message.contact, message.poses, message.displacement_m) == (None, None, None)
    assert message.reason.startswith("no poses of the magnets explain the field (χ² = ")
    assert made.memory.poses is not None
    assert not made.memory.poses.touch.touched, "a finger was not seen for so long that it may be gone"


def test_postponed_search_is_reported_and_made_up() -> None:
    made, lie = ready("4 over 12"), off(3, 600)
    for frame, _ in frames("4 over 12", 30, PRESS):
        waits = 12 <= frame.sequence < 20  # the first two have samples from before and after
        message = made.process(lie(frame.without_search() if waits else frame) if frame.sequence >= 10 else frame)
        if waits:
            assert (message.health, message.poses, made.search) == ("disturbed", None, "due")
            assert "a search for a wrong sensor is due, and waits for other pads" in message.reason
    assert message.health == "degraded"
    assert "sensor 4 contradicts all others" in message.reason


def test_poses_are_settled_before_they_are_ok_again() -> None:
    """After frames that nothing explains, ten in a row have to be explained."""
    made, pattern = ready("4 over 12"), np.array([1, -1, 1, -1, -1, 1, 1, -1, 1, 1, -1, -1]) * 140
    healths = []
    for frame, _ in frames("4 over 12", 60, PRESS):
        counts = frame.counts + (pattern[:, None] * [1, 0, 1]).astype(np.int16)
        message = made.process(replace(frame, counts=counts) if 10 <= frame.sequence < 20 else frame)
        healths.append((message.health, message.reason))
    assert [health for health, _ in healths[25:29]] == ["degraded"] * 4
    assert "these poses may be others than the true ones" in healths[28][1]
    assert healths[-1][0] == "ok"


def shifted(frame: Frame) -> Frame:
    """Another pattern of 10 µT than any poses make."""
    pattern = np.where(np.arange(24).reshape(8, 3) % 3 == np.arange(8)[:, None] % 2, 140, -140)
    return replace(frame, counts=frame.counts + pattern.astype(np.int16))


@pytest.mark.parametrize(
    ("health", "change"), [("lost", lambda frame: without(1)(without(2)(frame))), ("disturbed", shifted)]
)
def test_silicone_recovers_while_no_poses_explain_the_field(health: str, change: Callable[[Frame], Frame]) -> None:
    """It divides by 1 + t / 10 s in each time t, longer by the 0.2 s of the press, which these frames make shorter."""
    made, healths, left_t = ready("3 over 8"), set[str](), []
    for frame, _ in frames("3 over 8", 265, PRESS):
        message = made.process(frame if frame.sequence < 40 else change(frame))
        if frame.sequence >= 44:
            healths.add(message.health)
            assert made.memory.poses is not None
            left_t.append(made.memory.poses.recovery.recent_t)
    assert healths == {health}
    np.testing.assert_allclose(left_t[-1] / left_t[0], np.exp(-220 / 220 / 10.0), rtol=2e-3)


def test_pipeline_goes_on_from_anothers_memory_with_same_answers() -> None:
    name = "2 over 8"
    some = [frame for frame, _ in frames(name, 60, PRESS)]
    first, other = ready(name), ready(name)
    for frame in some[:30]:
        first.process(off(1, 600)(frame))  # a sensor is left out, and a finger presses
    restore(other, snapshot(first))
    for frame in some[30:]:
        assert essence(first.process(frame)) == essence(other.process(frame))
    with pytest.raises(BadMemoryError):
        restore(ready("4 over 12"), snapshot(first))
    with pytest.raises(BadMemoryError):
        restore(ready("4 over 8", "default"), snapshot(first))


def test_absence_ends_touch_and_bare_baseline_says_what_to_do() -> None:
    made = ready("2 over 8")
    for frame, _ in frames("2 over 8", 5, PRESS):
        made.process(frame)
    absent = made.absent("stale", "no frame for 0.5 s")
    assert (absent.health, absent.contact, absent.contacts, absent.poses) == ("stale", None, None, None)
    bare = ready("2 over 8")
    bare.use(msgspec.structs.replace(BASELINES["2 over 8"], rest=None))
    assert bare.process(frame).reason == BARE_ONLY


def test_shipped_model_is_not_used_for_other_magnets() -> None:
    model = contact_model_of(config_of("2 over 8", "default"))
    assert isinstance(model, NoContactModel)
    assert "the four magnets of docs/several.md, and this pad has others, or not all of them" in model.reason
    # Three magnets over five sensors: neither a table, nor enough values.
    three = config_of("3 over 8", "default")
    few = msgspec.structs.replace(three.geometry, sensors_mm=three.geometry.sensors_mm[:5])
    with pytest.raises(ModelError, match=r"is for another pad.*With 8 sensors it can publish touch and poses alone"):
        contact_model_of(msgspec.structs.replace(three, geometry=few))


def test_standard_magnets_have_their_table_in_any_order() -> None:
    config = config_of("4 over 8", "default")
    first, second, third, fourth = config.magnet, *config.other_magnets
    turned = msgspec.structs.replace(config, magnet=third, other_magnets=(second, fourth, first))
    model, other = contact_model_of(config), contact_model_of(turned)
    assert isinstance(model, ArrayModel)
    assert isinstance(other, ArrayModel)
    assert model.hash == other.hash
    one, two = (each.response.pressed(3.0, -4.0, 1.0).change.reshape(4, 5) for each in (model, other))
    assert (two == one[[2, 1, 3, 0]]).all()
    # A magnet of the other polarity makes another pad.
    upside_down = msgspec.structs.replace(config, magnet=msgspec.structs.replace(first, rest_axis=(0, 0, -1)))
    with pytest.raises(ModelError, match="is for another pad"):
        contact_model_of(upside_down)


def three_fingers(name: str, count: int) -> Iterator[tuple[Frame, np.ndarray]]:
    """0.9 N each: the third one is added to what the simulated pad knows of two."""
    source = SimulatedArray(config_of(name))
    source.finger, source.second_finger = steady_finger(-9e-3, -8e-3, 0.9), steady_finger(9e-3, -8e-3, 0.9)
    third, inside = Touch(0.0, 9e-3, 0.9), source.inside
    moved = inside.moved([[source.finger(0.0), source.second_finger(0.0), third]])[0]
    source.fields.inside = _Fixed(inside, third)  # type: ignore[assignment]
    for step in range(2 * count):
        for frame in source.poll(step * PERIOD_NS):
            if frame.sequence < count:
                yield frame, moved.position_m


class _Fixed:
    """The magnets under one finger more."""

    def __init__(self, inside: object, touch: Touch) -> None:
        self._inside, self._touch = inside, touch

    def field(self, place_m: np.ndarray, touches: list[Touch], warmer: float) -> np.ndarray:
        field: np.ndarray = self._inside.field(place_m, [*touches, self._touch], warmer)  # type: ignore[attr-defined]
        return field


@pytest.mark.parametrize("name", ["4 over 12", "4 over 16"])
def test_poses_are_published_if_no_two_fingers_explain_the_field(name: str) -> None:
    made, told = ready(name, "default"), 0
    for frame, position in three_fingers(name, 60):
        message = made.process(frame)
        assert message.health != "ok"
        assert (message.contacts, message.force_n) == (None, None)
        if message.poses is not None:
            told += 1
            assert (message.health, message.more, message.contact) == ("degraded", True, True)
            assert np.abs(errors(message, position)).max() < 5.0
    assert told >= 55
    assert _place(message) == "more than two fingers, or something of another shape"


def test_field_without_explanation_is_disturbed_without_poses() -> None:
    name = "4 over 12"
    made, pattern = ready(name, "default"), np.random.default_rng(7).choice([-140, 140], (12, 3)).astype(np.int16)
    for frame, _ in frames(name, 40, PRESS):
        message = made.process(replace(frame, counts=frame.counts + pattern))
        assert message.health == "disturbed"
        assert message.poses is None


def test_eight_sensors_under_four_magnets_publish_no_free_poses() -> None:
    made = ready("4 over 8", "default")
    for frame, _ in three_fingers("4 over 8", 30):
        message = made.process(frame)
        assert message.health != "ok"
        assert message.poses is None


def test_neighbour_gets_the_magnets_poses() -> None:
    made, beside = ready("2 over 8"), ready("4 over 8", "default")
    sighting = made.be_felt()
    placement = Placement(np.array([0.04, 0.0, 0.0]), np.eye(3), 3e-4)
    beside.feel(sighting, placement)
    for frame, now_m in frames("2 over 8", 20, PRESS):
        made.process(frame)
        position = now_m
    seen = np.array([one.position_m for one in sighting.last])
    deviation = np.sqrt(np.diagonal(sighting.covariance)).reshape(-1, 6)[:, :3]
    moved = seen - np.array([one.position_m for one in sighting.rest])
    true = position - SimulatedArray(config_of("2 over 8")).inside.magnets.position_m
    assert np.abs(true).max() > 2e-4
    assert (np.abs(moved - true) < 5.0 * deviation).all()


def test_pad_replays_from_a_recording(tmp_path: Path) -> None:
    name, path, said = "2 over 8", tmp_path / "two.mcap", []
    config, made = config_of(name), ready(name)
    writer = RecordingWriter(path)
    writer.add("state", config.name, msgspec.to_builtins(state_message(made, config, "boot")))
    for frame, _ in frames(name, 30, PRESS):
        writer.add("frame", config.name, msgspec.to_builtins(frame_message(frame, config.name, "boot", 1)))
        said.append(made.process(frame))
        writer.add("contact", config.name, msgspec.msgpack.decode(encode(said[-1])))
    writer.finish()
    writer.close()
    assert [essence(one) for one in Replay(path).contacts()] == [essence(one) for one in said]
    assert all(message.poses for message in said)
