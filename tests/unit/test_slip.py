"""`slip` of a pad that was asked for it, on simulated pads as they are built; and nothing else of any other pad."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import msgspec
import numpy as np
import pytest
from bus_messages import contact_message

from fmfts.bus.encoding import decode_contact
from fmfts.bus.messages import ContactMessage, EventMessage, SlipMessage, without_estimate
from fmfts.common.record import Record
from fmfts.config import Config, ContactConfig, PadConfig, SceneConfig, SimulatedSource, ToleranceConfig
from fmfts.config.checks import problems_in
from fmfts.contact import ContactModel
from fmfts.contact.contract import ModelError
from fmfts.pipeline import _pad
from fmfts.pipeline.first_memory import OF_SLIP, first_memory
from fmfts.pipeline.remembering import PadMemory
from fmfts.runtime.announcer import Announcer
from fmfts.sensor import Frame
from fmfts.sensor.source import SourceState
from fmfts_client import Contact
from fmfts_lab.bench.now_pads import BuiltPad
from fmfts_lab.bench.slip import messages
from fmfts_lab.bench.slip_world import Drag, DragMechanics, Healthy, Slide
from fmfts_lab.bench.tapped import ManyFrames
from fmfts_simulation.finger import Finger, Touch

PLOUGHS = "pressed in by a third of its radius, others by a fifth: 38 % more than friction holds it"
ASKED = ContactConfig(model="shear", slip=True)
SLIPPING = SlipMessage(slipping=True, sticking_probability=0.02, speed_m_per_s=0.05, friction=0.6)


@cache
def pad(contact: ContactConfig = ASKED, seed: int = 5) -> BuiltPad:
    source = SimulatedSource(seed=seed, finger="none", turning_deg_per_s=0.0)
    tolerance = ToleranceConfig(gain=0.005, sensor_rotation_deg=0.0, cross_axis=0.0)
    return BuiltPad.of(
        PadConfig(
            name="slip", source=source, tolerance=tolerance, scene=SceneConfig(ambient="constant"), contact=contact
        )
    )


def told(finger: Finger, seconds: float, contact: ContactConfig = ASKED) -> list[ContactMessage]:
    source = ManyFrames(pad(contact).config)
    source.finger = finger
    return messages(pad(contact), source, seconds)


def slide(angle: float, friction: float = 0.6, speed_m_per_s: float = 0.05) -> Slide:
    along = np.array([np.cos(angle), np.sin(angle)])
    return Slide(-2e-3 * along, along, 1.5, friction, speed_m_per_s, 4e-3, 0.3)


def slip_of(message: ContactMessage) -> SlipMessage | None:
    """None where nothing is known."""
    return message.slip if isinstance(message.slip, SlipMessage) and message.slip.slipping is not None else None


@pytest.mark.parametrize("angle", np.deg2rad([0.0, 40.0, 90.0, 130.0, 180.0, -45.0, -90.0, -160.0]).tolist())
def test_slip_has_one_onset_its_direction_and_friction(angle: float) -> None:
    finger = slide(angle)
    found = told(finger, finger.seconds)
    begin_s, end_s = finger.slips_s
    slipping = np.array([message.slipping for message in found])
    onsets = np.flatnonzero(slipping & ~np.append(False, slipping[:-1]))
    assert len(onsets) == 1
    assert begin_s - 0.01 < onsets[0] / 220 < begin_s + 0.05
    assert not slipping[round((end_s + 0.1) * 220) :].any()
    last = [one for one in map(slip_of, found) if one is not None and one.slipping][-1]
    away = (last.direction_rad - angle + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(away) < 4.0 * last.direction_sd_rad
    assert last.friction is not None
    assert last.friction_sd is not None
    assert abs(last.friction - finger.friction) < 3.0 * last.friction_sd
    assert abs(last.friction - finger.friction) < 0.15


def test_faster_slip_is_noticed_sooner() -> None:
    delays = []
    for speed in (0.01, 0.05, 0.2):
        finger = slide(0.7, speed_m_per_s=speed)
        found = told(finger, finger.seconds)
        delays.append(next(i for i, message in enumerate(found) if message.slipping) / 220 - finger.slips_s[0])
    assert delays == sorted(delays, reverse=True)
    assert delays[-1] < 0.025


@pytest.mark.parametrize("kind", ["hold", "shear", "jerk", "press"])
def test_finger_that_sticks_does_not_slip(kind: str) -> None:
    finger = Healthy.drawn(np.random.default_rng(8), kind)
    found = told(finger, finger.seconds)
    assert not any(message.slipping for message in found)
    assert any(slip_of(message) is not None for message in found)


def test_finger_that_rolls_hard_does_not_slip() -> None:
    finger = Healthy.drawn(np.random.default_rng(9), "roll")
    found = told(lambda time_s: finger(time_s)._replace(force_n=1.8 if finger(time_s).force_n > 0.3 else 0.0), 20.0)
    assert not any(message.slipping for message in found)


def test_slow_slip_is_noticed_after_a_third_of_a_millimetre() -> None:
    """What the baseline leaves unknown is no noise: counted as such, it hides this slip for a third longer."""
    finger = slide(0.7, speed_m_per_s=0.005)
    found = told(finger, finger.seconds)
    onset_s = next(i for i, message in enumerate(found) if message.slipping) / 220
    assert 0.0 < onset_s - finger.slips_s[0] < 0.067


def test_shear_before_the_pull_tells_the_error_of_shear() -> None:
    """Without it, the baseline's error is in the friction, and its deviation includes all of it."""
    source, pipeline = ManyFrames(pad().config), pad().pipeline()
    source.finger = slide(0.4)
    frames = [frame for frames in source.batches(600) for frame in frames]
    onset = next(number for number, frame in enumerate(frames) if pipeline.process(frame).slipping)
    memory, found = pipeline.memory, []
    for weight in (memory.fields["first_weight"], np.zeros(())):
        pipeline.recall(replace(memory, fields=memory.fields | {"first_weight": weight}))
        found.append(slip_of(pipeline.process(frames[onset + 1])))
    known, unknown = found
    assert known is not None
    assert unknown is not None
    assert known.friction_sd is not None
    assert unknown.friction_sd is not None
    assert known.friction != unknown.friction
    assert known.friction_sd < 0.99 * unknown.friction_sd


def test_friction_is_forgotten_when_the_touch_ends() -> None:
    finger = slide(0.0)
    again = lambda time_s: finger(time_s % 3.0)  # noqa: E731
    assert finger.seconds < 3.0
    found = [slip_of(message) for message in told(again, 4.2)]
    first = [one for one in found[: 3 * 220] if one is not None]
    second = [one for one in found[3 * 220 : round(3.7 * 220)] if one is not None]
    assert first[-1].friction is not None
    assert second
    assert all(one.friction is None and one.margin_n is None for one in second)


def learnt_under(allowed: tuple[float, float], friction: float) -> SlipMessage:
    """A pad's result with these bounds for the frame after the onset of a slip, from which nothing is learned yet.

    contact.friction is above all of them, so that the prior of a frame's shear is the same.
    """
    source, pipeline = ManyFrames(pad().config), pad().pipeline()
    source.finger = slide(0.4, friction)
    frames = [frame for frames in source.batches(600) for frame in frames]
    onset = next(number for number, frame in enumerate(frames) if pipeline.process(frame).slipping)
    memory = pipeline.memory
    fields = memory.fields | {name: np.zeros(()) for name in ("learnt_weight", "learnt_friction")}
    other = pad(msgspec.structs.replace(ASKED, slip_friction=allowed, friction=4.0)).pipeline()
    other.recall(replace(memory, fields=fields))
    slip = slip_of(other.process(frames[onset + 1]))
    assert slip is not None
    assert slip.slipping
    return slip


@pytest.mark.parametrize(("allowed", "friction"), [((0.66, 1.2), 0.45), ((0.2, 0.5), 0.8)])
def test_friction_beyond_slip_friction_is_published(allowed: tuple[float, float], friction: float) -> None:
    """Bounds tell slips from rolling. The margin counts on no more than the upper one, whose deviation says so."""
    found, free = (learnt_under(bounds, friction) for bounds in (allowed, (0.01, 4.0)))
    assert found.friction is not None
    assert found.friction_sd is not None
    assert free.friction is not None
    assert free.friction_sd is not None
    assert found.friction == pytest.approx(min(free.friction, allowed[1]), rel=1e-9)
    assert found.friction_sd == pytest.approx(np.hypot(free.friction_sd, free.friction - found.friction), rel=1e-9)
    assert not allowed[0] < free.friction < allowed[1]


def test_margin_is_friction_times_force_less_shear() -> None:
    finger = slide(1.0)
    known = [m for m in told(finger, finger.seconds) if (one := slip_of(m)) is not None and one.margin_n is not None]
    assert len(known) > 60
    for message in known[-60:]:
        slip = slip_of(message)
        assert slip is not None
        assert slip.margin_n is not None
        assert slip.margin_sd_n is not None
        assert abs(slip.margin_n) < 5.0 * slip.margin_sd_n  # the finger has just slipped, and is still pulled


def test_slip_does_not_change_other_fields() -> None:
    finger = slide(2.0)
    without = told(finger, finger.seconds, ContactConfig(model="shear", friction=ASKED.slip_friction[1]))
    times = {"t_publish_ns": 0, "utc_ns": 0, "baseline": None}
    for asked, plain in zip(told(finger, finger.seconds), without, strict=True):
        assert plain.slip is msgspec.UNSET
        assert msgspec.structs.replace(asked, slip=msgspec.UNSET, **times) == msgspec.structs.replace(plain, **times)


def test_pad_without_slip_setting_leaves_the_slip_memory() -> None:
    plain = pad(ContactConfig(model="shear"))
    source, pipeline = ManyFrames(plain.config), plain.pipeline()
    source.finger = slide(0.0)
    for frames in source.batches(600):
        for frame in frames:
            pipeline.process(frame)
    assert not any(np.any(pipeline.memory.fields[name]) for name in OF_SLIP)


def test_memory_of_a_version_without_slip_is_accepted() -> None:
    pipeline = pad().pipeline()
    before = pipeline.memory
    older = {name: value for name, value in before.fields.items() if name not in OF_SLIP}
    pipeline.recall(PadMemory(older, before.sighting, before.why_no_baseline, before.sensors, before.has_baseline))
    assert set(pipeline.memory.fields) == set(before.fields)


def test_memory_of_smaller_slip_filters_is_accepted() -> None:
    finger = slide(0.0)
    source, pipeline = ManyFrames(pad().config), pad().pipeline()
    source.finger = finger
    for frames in source.batches(330):
        for frame in frames:
            pipeline.process(frame)
    before = pipeline.memory
    assert before.fields["slip_frames"] > 0.0
    pipeline.recall(replace(before, fields=before.fields | {"slip_state": np.zeros(21)}))
    after = pipeline.memory.fields
    assert after["slip_state"].shape == before.fields["slip_state"].shape
    assert not any(np.any(after[name]) for name in OF_SLIP)
    assert np.array_equal(after["state"], before.fields["state"])


def test_fields_of_slip_are_those_of_the_memory() -> None:
    memory = Record(_pad.MEMORY)
    memory.fill(first_memory(pad().config.pad(), None))
    assert set(OF_SLIP) <= set(memory.copy())


def replace_number(frame: Frame, number: int) -> Frame:
    values = (frame.gain_code, frame.counts, frame.age_us, frame.fresh, frame.valid, frame.temperature_c)
    return Frame(frame.pad_index, number, frame.device_time_us, frame.host_time_ns, *values)


def without_news(frame: Frame, number: int) -> Frame:
    """2 ms after it, as a bus gives it that is read faster than the chips measure: with the same samples."""
    old = np.zeros(len(frame.fresh), dtype=bool)
    age_us = (frame.age_us + 2000).astype(np.uint16)
    device_us, host_ns = frame.device_time_us + 2000, frame.host_time_ns + 2_000_000
    values = (frame.gain_code, frame.counts, age_us, old, frame.valid, frame.temperature_c)
    return Frame(frame.pad_index, number, device_us, host_ns, *values)


@pytest.mark.parametrize("kind", ["slide", "jerk"])
def test_repeated_samples_add_no_information(kind: str) -> None:
    finger = slide(0.7) if kind == "slide" else Healthy.drawn(np.random.default_rng(8), kind)
    source, pipeline = ManyFrames(pad().config), pad().pipeline()
    source.finger = finger
    once, twice = told(finger, 1.5), []
    for number, frame in enumerate(frame for frames in source.batches(330) for frame in frames):
        twice.append(pipeline.process(replace_number(frame, 2 * number)))
        again = pipeline.process(without_news(frame, 2 * number + 1))
        assert again.slipping == twice[-1].slipping
    known = [both for both in zip(map(slip_of, once), map(slip_of, twice), strict=True) if None not in both]
    assert len(known) > 100
    for one, other in known:
        assert one is not None
        assert other is not None
        assert one.slipping == other.slipping
        assert one.speed_sd_m_per_s == pytest.approx(other.speed_sd_m_per_s, rel=0.02)


def test_model_without_shear_refuses_slip() -> None:
    with pytest.raises(ModelError, match="model that measures shear"):
        ContactModel.load("default", pad().config.pad(), slip_friction=(0.2, 1.2))


def test_absent_frame_has_no_slip_and_keeps_the_key() -> None:
    pipeline = pad().pipeline()
    absent = pipeline.absent("stale", "silent")
    assert absent.slip == SlipMessage()
    finger = slide(0.0)
    slipping = next(message for message in told(finger, finger.seconds) if message.slipping)
    assert without_estimate(slipping).slip == SlipMessage()


def test_client_reads_what_the_daemon_sends() -> None:
    finger = slide(0.0)
    slipping = next(message for message in told(finger, finger.seconds) if message.slipping)
    contact = Contact.from_message(msgspec.to_builtins(slipping))
    assert contact.slip is not None
    assert contact.slip.slipping
    assert msgspec.to_builtins(slipping.slip) == vars(contact.slip)
    plain = msgspec.to_builtins(slipping)
    del plain["slip"]
    assert Contact.from_message(plain).slip is None
    assert decode_contact(msgspec.msgpack.encode(slipping)) == slipping


@pytest.mark.parametrize("drag", Drag.read(), ids=lambda drag: str(drag.name))
def test_dragged_ball_sticks_before_it_slips(drag: Drag) -> None:
    assert 0.0 < drag.slips_from_mm < 1.0
    rest = DragMechanics(drag).response(np.zeros(1), np.zeros(1), np.zeros(1))
    assert not rest.any()


@pytest.mark.parametrize(
    "drag",
    [
        pytest.param(drag, id=drag.name, marks=[pytest.mark.xfail(reason=PLOUGHS)] * (drag.name == "small"))
        for drag in Drag.read()
    ],
)
def test_dragged_ball_is_held_by_its_friction(drag: Drag) -> None:
    load = drag.load_n[drag.first + 1 :]
    ratio = np.hypot(load[:, 1], load[:, 2]) / load[:, 0]
    assert ratio.max() == pytest.approx(drag.friction, rel=0.35)


def test_light_touch_reports_no_slip() -> None:
    found = told(lambda time_s: Touch(0.0, 0.0, 0.1 if time_s > 0.3 else 0.0), 1.0)
    assert all(message.slip == SlipMessage() for message in found)


def test_check_of_a_config_refuses_slip_without_shear() -> None:
    wrong = msgspec.structs.replace(pad().config, contact=ContactConfig(slip=True))
    told_of = [text for keys, text in problems_in(Config(pad=(wrong,))) if keys[-1] == "slip"]
    assert told_of
    assert "needs a model with shear" in told_of[0]
    turned = ContactConfig(model="shear", slip=True, slip_friction=(1.2, 0.2))
    wrong = msgspec.structs.replace(pad().config, contact=turned)
    assert [keys[-1] for keys, _ in problems_in(Config(pad=(wrong,)))] == ["slip_friction"]


def test_check_of_a_config_refuses_slip_without_friction() -> None:
    wrong = msgspec.structs.replace(pad().config, contact=ContactConfig(model="shear", slip=True, friction=0.0))
    assert [keys[-1] for keys, _ in problems_in(Config(pad=(wrong,)))] == ["friction"]


def test_onset_and_end_of_a_slip_are_events() -> None:
    sent = Sent()
    announcer = Announcer("slip", sent, sent, "boot", 0, sent)  # type: ignore[arg-type]
    finger = slide(0.0)
    for message in told(finger, finger.seconds):
        announcer.send(message)
    assert [kind for kind in sent.kinds if kind in ("slip", "stick")] == ["slip", "stick"]


@pytest.mark.parametrize(
    ("changes", "detail"),
    [
        ({"slip": msgspec.structs.replace(SLIPPING, slipping=False)}, ""),
        ({"slip": SlipMessage(), "contact": False}, "the touch ended"),
        ({"slip": SlipMessage(), "contact": None}, "it is no longer known whether the finger slips"),
        ({"slip": SlipMessage()}, "it is no longer known whether the finger slips"),
    ],
)
def test_end_of_a_slip_says_whether_the_finger_sticks(changes: dict[str, Any], detail: str) -> None:
    sent = Sent()
    announcer = Announcer("slip", sent, sent, "boot", 0, sent)  # type: ignore[arg-type]
    announcer.send(contact_message(slip=SLIPPING))
    announcer.send(contact_message(**changes))
    assert ("stick", detail) in sent.details


class Sent:
    """Source, publisher and log, of which only the events matter. kinds, details: of the events that were sent."""

    def __init__(self) -> None:
        self.kinds: list[str] = []
        self.details: list[tuple[str, str]] = []
        self.state = SourceState(description="")

    def send_contact(self, name: str, message: ContactMessage) -> ContactMessage:
        return message

    def send_event(self, name: str, event: EventMessage) -> None:
        self.kinds.append(event.kind)
        self.details.append((event.kind, event.detail))

    def tell(self, *args: object, **more: object) -> None:
        """A line of the log."""
