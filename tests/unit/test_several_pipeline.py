"""A pad with four magnets from its frames to its messages: health, faults, memory, and what a baseline does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from fmfts.baseline import BaselineError
from fmfts.bus.encoding import decode_contact, encode
from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig, SiliconeConfig
from fmfts.pad import Array, rotation_from_vector
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.pipeline.snapshot import BadMemoryError, restore, snapshot
from fmfts.pipeline.words import BARE_ONLY
from fmfts.sensor import Frame
from fmfts.several import estimator
from fmfts.several.poses import Poses, poses_of
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.array import SimulatedArray
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch, no_finger, steady_finger
from fmfts_simulation.source import TURNING_AXIS

CONFIG = array_config(seed=3)
PERIOD_NS = round(1e9 / 220)
LEFT, RIGHT = steady_finger(-6e-3, -1e-3, 0.8), steady_finger(7e-3, 3e-3, 0.7)


def pipeline(config: PadConfig = CONFIG) -> SeveralPipeline:
    made = pipeline_of(config, contact_model_of(config), "boot")
    assert isinstance(made, SeveralPipeline)
    return made


def ready() -> SeveralPipeline:
    made = pipeline()
    made.use(simulated_baseline(CONFIG))
    return made


def frames(count: int, finger: Finger = no_finger, second: Finger | None = None) -> Iterator[Frame]:
    source = SimulatedArray(CONFIG)
    source.finger, source.second_finger = finger, second
    for step in range(2 * count):
        for frame in source.poll(step * PERIOD_NS):
            if frame.sequence < count:
                yield frame


def told(made: SeveralPipeline, some: Iterator[Frame]) -> list[ContactMessage]:
    return [made.process(frame) for frame in some]


def without(frame: Frame, sensor: int) -> Frame:
    valid = frame.valid.copy()
    valid[sensor] = False
    return replace(frame, valid=valid)


def off(frame: Frame, sensor: int, counts: int) -> Frame:
    changed = frame.counts.copy()
    changed[sensor, 0] += counts
    return replace(frame, counts=changed)


def test_untouched_turning_pad_is_healthy_and_reports_no_finger() -> None:
    messages = told(ready(), frames(330))
    assert all(message.health == "ok" and message.contact is False and message.contacts == [] for message in messages)
    last = messages[-1]
    assert last.force_n == 0.0
    assert last.force_sd_n is not None
    assert 0.005 < last.force_sd_n < 0.2  # a finger may press undetected: some 0.05 N over √3
    assert last.pose is None
    assert isinstance(last.poses, list)
    assert len(last.poses) == 4


def test_two_fingers_are_reported_with_their_resultant() -> None:
    message = told(ready(), frames(20, LEFT, RIGHT))[-1]
    assert isinstance(message.contacts, list)
    one, other = sorted(message.contacts, key=lambda finger: finger.x_m)
    for finger, true in ((one, (-6e-3, -1e-3, 0.8)), (other, (7e-3, 3e-3, 0.7))):
        assert abs(finger.x_m - true[0]) < 4.0 * finger.x_sd_m
        assert abs(finger.y_m - true[1]) < 4.0 * finger.y_sd_m
        assert abs(finger.force_n - true[2]) < 4.0 * finger.force_sd_n
    assert message.force_n == pytest.approx(one.force_n + other.force_n)
    assert message.x_m == pytest.approx(
        (one.x_m * one.force_n + other.x_m * other.force_n) / (one.force_n + other.force_n)
    )
    assert decode_contact(encode(message)) == message


def test_poses_go_with_the_fingers() -> None:
    """The magnet at (−6, −6) mm is under the finger: it goes down by 0.4 mm a newton and more, the farthest by less."""
    made = ready()
    rest = told(made, frames(5))[-1]
    pressed = told(ready(), frames(5, steady_finger(-6e-3, -6e-3, 1.0)))[-1]
    assert isinstance(rest.poses, list)
    assert isinstance(pressed.poses, list)
    assert rest.poses[0].ambient_t is not None
    assert pressed.poses[0].ambient_t is None  # its deviation under a finger is not kept
    down = [after.position_m[2] - before.position_m[2] for before, after in zip(rest.poses, pressed.poses, strict=True)]
    assert down[3] < -4e-4
    assert down[3] < min(down[:3])


def test_poses_are_computed_once_frame_also_where_pad_beside_it_needs_them(monkeypatch: pytest.MonkeyPatch) -> None:
    computed: list[int] = []

    def counted(*of: Any) -> Poses:
        computed.append(1)
        return poses_of(*of)

    monkeypatch.setattr(estimator, "poses_of", counted)
    made = ready()
    made.be_felt()
    said = told(made, frames(5, LEFT))
    assert all(message.poses and message.contacts for message in said)
    assert len(computed) == len(said)


def test_silent_sensor_degrades_but_two_fingers_are_published() -> None:
    message = told(ready(), (without(frame, 2) for frame in frames(20, LEFT, RIGHT)))[-1]
    assert (message.health, message.sensors_ok) == ("degraded", 0xFB)
    assert message.reason == "sensor 3 is silent"
    assert isinstance(message.contacts, list)
    assert len(message.contacts) == 2


def test_too_few_sensors_are_lost_and_say_why() -> None:
    some = frames(10, LEFT)
    message = told(ready(), (without(without(without(without(f, 0), 1), 2), 3) for f in some))[-1]
    assert (message.health, message.contact, message.contacts) == ("lost", None, None)
    assert "only 12 values are left, and two fingers need 13; sensor 1 is silent" in message.reason
    assert "sensor 1 is silent" in message.reason


@pytest.mark.parametrize("sensor", [0, 5])
def test_contradicting_sensor_is_named_and_excluded_until_it_agrees(sensor: int) -> None:
    """60 counts are 4 µT, twenty deviations of its noise."""
    made, messages = ready(), []
    for frame in frames(60, LEFT):
        messages.append(made.process(off(frame, sensor, 60) if 10 <= frame.sequence < 20 else frame))
    during, after = messages[12:20], messages[-1]
    assert all(message.health != "ok" or _is_right(message) for message in messages)
    assert {message.health for message in during} == {"degraded"}
    assert all(f"sensor {sensor + 1} contradicts all others" in message.reason for message in during)
    assert all(_is_right(message) for message in during)
    assert not [message.reason for message in messages if "stuck" in message.reason]
    assert after.health == "ok"


def _is_right(message: ContactMessage) -> bool:
    """Within five deviations of LEFT."""
    if not isinstance(message.contacts, list) or len(message.contacts) != 1:
        return False
    finger = message.contacts[0]
    error = (
        (finger.x_m + 6e-3) / finger.x_sd_m,
        (finger.y_m + 1e-3) / finger.y_sd_m,
        (finger.force_n - 0.8) / finger.force_sd_n,
    )
    return max(map(abs, error)) < 5.0


def test_magnet_nearby_is_no_finger() -> None:
    """A field with a gradient that no finger makes: 10 µT that change sign from sensor to sensor."""
    made, pattern = ready(), np.array([1, -1, 1, -1, -1, 1, 1, -1]) * 140
    for frame in frames(30, LEFT):
        changed = frame.counts + (pattern[:, None] * [1, 0, 1]).astype(np.int16)
        message = made.process(replace(frame, counts=changed) if frame.sequence >= 10 else frame)
    assert message.health in ("disturbed", "degraded")
    assert message.contacts is None
    assert message.force_n is None


def test_press_beyond_table_publishes_only_a_lower_bound() -> None:
    message = told(ready(), frames(8, steady_finger(2e-3, 2e-3, 4.0)))[-1]
    assert (message.contact, message.over_range, message.contacts, message.force_n) == (True, True, None, None)
    assert message.force_min_n == pytest.approx(3.0, abs=0.1)
    assert message.poses is message.now is None


def test_missing_rest_baseline_says_what_to_do() -> None:
    made = pipeline()
    first = told(made, frames(2))[-1]
    assert (first.health, first.contact, first.contacts) == ("no_baseline", None, None)
    made.use(msgspec.structs.replace(simulated_baseline(CONFIG), rest=None))
    assert told(made, frames(2))[-1].reason == BARE_ONLY
    made.refuse("another pad's")
    assert told(made, frames(2))[-1].reason == "another pad's"


@pytest.mark.parametrize("place", [(11e-3, 11e-3, 0.15), (12.5e-3, 0.0, 0.3), (13e-3, 3e-3, 0.5), (0.0, 0.0, 0.3)])
def test_finger_that_is_held_stays_same_finger_all_over_pad(place: tuple[float, float, float]) -> None:
    """Near the edge its force alone is known badly, and its place with it: it presses all the same."""
    messages = told(ready(), frames(120, steady_finger(*place)))[5:]
    fingers = [message.contacts[0] for message in messages if message.contacts]
    assert {message.health for message in messages} == {"ok"}
    assert len(fingers) == len(messages)
    assert len({finger.id for finger in fingers}) == 1
    assert max(abs(finger.force_n - place[2]) / finger.force_sd_n for finger in fingers) < 5.0


def test_fingers_that_lift_are_gone_with_the_frame() -> None:
    """Two frames: the samples of chips on their own clocks, before and after, are in the first of them."""

    def lifting(finger: Finger) -> Finger:
        return lambda time_s: finger(time_s) if time_s < 0.1 else Touch(0.0, 0.0, 0.0)

    messages = told(ready(), frames(40, lifting(LEFT), lifting(RIGHT)))
    counts = [len(message.contacts) for message in messages if isinstance(message.contacts, list)]
    assert counts[15] == 2
    assert counts[-14:] == [0] * 14
    told_places = [finger.x_sd_m for message in messages for finger in message.contacts or []]
    assert max(told_places) < 40e-3


def test_three_fingers_are_never_reported_as_two_wrong_ones() -> None:
    """Three of 0.6 N each: said to be more, or disturbed."""
    said = []
    for x_m, y_m in ((0.0, 9e-3), (2e-3, -10e-3), (-9e-3, 9e-3), (9e-3, -9e-3), (0.0, -9e-3)):
        made = ready()
        source = SimulatedArray(CONFIG)
        both = (steady_finger(-8e-3, -1e-3, 0.6), steady_finger(8e-3, 2e-3, 0.6), steady_finger(x_m, y_m, 0.6))
        source.finger, source.second_finger = both[0], both[1]
        known = source.inside.field
        source.fields.inside = _Third(known, both[2](0.0))  # type: ignore[assignment]
        for step in range(40):
            for frame in source.poll(step * PERIOD_NS):
                message = made.process(frame)
        said.append((message.health, message.more))
        assert message.health != "ok"
        assert message.contacts is None
        assert message.force_n is None
    assert sum(more for _, more in said) >= 3  # of five; 54 to 58 % in lab/results/several.md


def test_three_fingers_that_stay_are_reported_to_be_more_until_one_goes() -> None:
    """In some frames two explain the field by chance. Never is all said to be well."""
    made, source = ready(), SimulatedArray(CONFIG)
    source.second_finger = steady_finger(8e-3, 2e-3, 0.6)
    source.fields.inside = third = _Third(source.inside.field, no_finger(0.0))  # type: ignore[assignment]

    def press(force_n: float, first_n: float, steps: range) -> list[ContactMessage]:
        third.touch = steady_finger(0.0, 9e-3, force_n)(0.0)
        source.finger = steady_finger(-8e-3, -1e-3, first_n)  # fields are computed anew when it changes
        return [made.process(frame) for step in steps for frame in source.poll(step * PERIOD_NS)]

    assert press(0.0, 0.6, range(20))[-1].health == "ok"
    three = press(0.6, 0.601, range(20, 170))
    assert all(message.health != "ok" for message in three)
    assert sum(bool(message.more) for message in three) >= 0.95 * len(three)
    two = press(0.0, 0.602, range(170, 230))[-1]
    assert (two.health, len(two.contacts or ())) == ("ok", 2)


@pytest.mark.parametrize(
    ("strong", "weak"),
    [((2.0, -8.9), (8.0, -1.0)), ((0.6, 4.5), (9.1, 9.8)), ((0.0, 2.1), (9.2, -1.9)), ((-1.5, 6.4), (8.4, 5.3))],
)
def test_two_fingers_that_look_like_one_degrade(strong: tuple[float, float], weak: tuple[float, float]) -> None:
    """1.6 and 0.4 N, 10 mm apart: less than a second finger needs to be told, more than one finger alone has."""
    pressed = [steady_finger(x * 1e-3, y * 1e-3, force_n) for (x, y), force_n in ((strong, 1.6), (weak, 0.4))]
    message = told(ready(), frames(12, *pressed))[-1]
    assert message.contacts is not None
    assert len(message.contacts) == 1
    assert message.health == "degraded"
    assert "two that are too near or too unequal to be told apart may press" in message.reason


class _Third:
    """Magnets under one more finger."""

    def __init__(self, field: Callable[..., Array], touch: Touch) -> None:
        self._field, self.touch = field, touch

    def field(self, place_m: Array, touches: list[Touch], warmer: float) -> Array:
        return self._field(place_m, [*touches, self.touch], warmer)


def test_second_sensor_that_fails_after_the_first_is_found() -> None:
    made = ready()
    for frame in frames(200, LEFT):
        frame = off(frame, 0, 600) if 10 <= frame.sequence < 30 else frame
        message = made.process(off(frame, 5, 600) if frame.sequence >= 28 else frame)
    assert (message.health, message.contact) == ("degraded", True)
    assert "sensor 6 contradicts all others" in message.reason
    assert _is_right(message)


def test_sensor_that_is_bad_before_the_touch_began_is_found() -> None:
    made = ready()
    for frame in frames(60, LEFT):
        message = made.process(off(frame, 5, 600))
    assert message.health == "degraded"
    assert "sensor 6 contradicts all others" in message.reason
    assert _is_right(message)


def test_residual_is_of_the_sensors_that_are_used() -> None:
    """Noise is 0.2 µT, what the baseline leaves open some more; a silent sensor would bring 66 µT."""
    message = told(ready(), (without(frame, 2) for frame in frames(20, LEFT)))[-1]
    assert isinstance(message.poses, list)
    assert message.poses[0].residual_t < 3e-6


def test_without_friction_no_shear_is_reported() -> None:
    contact = msgspec.structs.replace(CONFIG.contact, friction=0.0)
    made = pipeline(msgspec.structs.replace(CONFIG, contact=contact))
    made.use(simulated_baseline(CONFIG))
    message = told(made, frames(10, LEFT))[-1]
    assert message.contacts
    assert message.contacts[0].shear_x_n is message.contacts[0].shear_x_sd_n is message.shear_x_n is None


def test_turned_ambient_field_is_within_its_deviation() -> None:
    message = told(ready(), frames(330))[-1]
    source = SimulatedArray(CONFIG)
    true_t = rotation_from_vector(TURNING_AXIS * source.turning_rad_per_s * 329 / 220) @ source.built.ambient_t
    assert isinstance(message.poses, list)
    assert message.poses[0].ambient_t is not None
    assert message.poses[0].ambient_sd_t is not None
    error = (np.array(message.poses[0].ambient_t) - true_t) / np.array(message.poses[0].ambient_sd_t)
    assert np.abs(error).max() < 4.0
    assert max(message.poses[0].ambient_sd_t) < 3e-6


def test_new_baseline_begins_with_new_fingers_and_bad_one_changes_nothing() -> None:
    made = ready()
    before = told(made, frames(8, LEFT))[-1]
    made.use(simulated_baseline(CONFIG))
    after = told(made, frames(8, LEFT))[-1]
    assert before.contacts
    assert after.contacts
    assert after.contacts[0].id > before.contacts[0].id
    rest = simulated_baseline(CONFIG).rest
    assert rest is not None
    bad = msgspec.structs.replace(
        simulated_baseline(CONFIG), rest=msgspec.structs.replace(rest, mean_t=[[0.0] * 3] * 8)
    )
    with pytest.raises(BaselineError):
        made.use(bad)
    assert told(made, frames(8, LEFT))[-1].health == "ok"


def test_silicone_that_comes_back_slowly_is_no_finger() -> None:
    """After 2 N for two seconds 6 % of the movement are left: one deviation of a silicone that creeps by 5 %. A pad
    whose silicone does not creep takes that for a finger of 0.12 N."""

    def finger(time_s: float) -> Touch:
        return Touch(-6e-3, -6e-3, float(np.interp(time_s, (0.5, 0.55, 2.5, 2.55), (0.0, 2.0, 2.0, 0.12))))

    found = {}
    for creep in (0.05, 0.0):
        silicone = SiliconeConfig(creep_per_decade=creep, hysteresis=creep / 2.0)
        made = pipeline(msgspec.structs.replace(CONFIG, silicone=silicone))
        made.use(simulated_baseline(CONFIG))
        messages = told(made, frames(770, finger))
        assert messages[300].contact
        assert all(message.health == "ok" for message in messages)
        found[creep] = [message.contact for message in messages[-100:]]
    assert not any(found[0.05])
    assert all(found[0.0])


def test_pad_at_a_low_rate_keeps_its_finger() -> None:
    slow = msgspec.structs.replace(CONFIG, source=msgspec.structs.replace(CONFIG.source, rate_hz=19))
    made = pipeline(slow)
    made.use(simulated_baseline(slow))
    source = SimulatedArray(slow)
    source.finger = LEFT
    messages = [made.process(frame) for step in range(20) for frame in source.poll(round(step * 1e9 / 19))]
    ids = {message.contacts[0].id for message in messages[3:] if isinstance(message.contacts, list)}
    assert len(ids) == 1


def test_absence_ends_the_touch() -> None:
    made = ready()
    before = told(made, frames(8, LEFT))[-1]
    silent = made.absent("disconnected", "unplugged")
    assert (silent.health, silent.contact, silent.contacts, silent.more) == ("disconnected", None, None, False)
    again = told(made, frames(8, LEFT))[-1]
    assert isinstance(before.contacts, list)
    assert isinstance(again.contacts, list)
    assert again.contacts[0].id != before.contacts[0].id


def test_pipeline_goes_on_from_another_s_memory_with_same_answers() -> None:
    one, some = ready(), list(frames(30, LEFT, RIGHT))
    for frame in some[:15]:
        one.process(frame)
    other, content = ready(), snapshot(one)
    restore(other, content)
    for frame in some[15:]:
        mine, theirs = one.process(frame), other.process(frame)
        assert msgspec.structs.replace(mine, t_publish_ns=0, utc_ns=0) == msgspec.structs.replace(
            theirs, t_publish_ns=0, utc_ns=0
        )
    with pytest.raises(BadMemoryError):
        restore(pipeline(), content)  # it has no baseline


def test_baseline_of_another_number_of_magnets_is_refused() -> None:
    fewer = msgspec.structs.replace(CONFIG, other_magnets=CONFIG.other_magnets[:2])
    with pytest.raises(BaselineError):
        simulated_baseline(CONFIG).array_mounting(fewer.pad())
