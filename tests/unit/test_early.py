"""Samples that come before their frames: each is used once, in order, and published only if it updates `now`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from fast_loop_host import LEAD, Bus, Host, Told, sample_of
from test_fast_loop import bus  # noqa: F401  (a fixture)
from test_link import hello

from fmfts.bus.messages import ContactMessage
from fmfts.config import ContactConfig
from fmfts.contact import ContactModel
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.encoded import message_of
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.snapshot import restore, snapshot
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor.early import EarlySample
from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.packets import Early, Sample
from fmfts_lab.bench import now as bench
from fmfts_lab.bench.drills import RATE_HZ, pad_config
from fmfts_lab.bench.motions import hold, tap
from fmfts_lab.bench.now_early import EarlyToo, Sent
from fmfts_recording.replay import essence
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch

CONFIG = pad_config("drifting", 5)


@pytest.fixture(scope="module")
def model() -> ContactModel:
    return load_contact_model(CONFIG)


def pipeline_with(model: ContactModel, lead: Lead = LEAD) -> PadPipeline:
    tracking = tracking_model_for(CONFIG.scene, CONFIG.magnet).tracking
    pipeline = PadPipeline(CONFIG.pad(), model, "early", float(RATE_HZ), tracking, lead=lead)
    pipeline.use(simulated_baseline(CONFIG))
    return pipeline


def sent_of(finger: Finger, seconds: float) -> list[Sent]:
    source = EarlyToo(CONFIG, 460800)
    source.finger = finger
    return [packet for _, packet in source.sent(seconds)]


def tapped(time_s: float) -> Touch:
    within = (time_s - 0.2) / 0.05
    return Touch(2e-3, 1e-3, 0.5 * (1.0 - np.cos(2.0 * np.pi * within)) if 0.0 < within < 1.0 else 0.0)


def pressed(time_s: float) -> Touch:
    return Touch(2e-3, 1e-3, 0.8 if time_s > 0.1 else 0.0)


def answer(pipeline: PadPipeline, packet: Sent) -> ContactMessage | None:
    told = pipeline.early(packet) if isinstance(packet, EarlySample) else pipeline.answer(packet)
    return message_of(told)


def messages_of(pipeline: PadPipeline, packets: Iterable[Sent]) -> list[ContactMessage]:
    return [message for packet in packets if (message := answer(pipeline, packet)) is not None]


def frames_only(packets: Iterable[Sent]) -> list[Sent]:
    return [packet for packet in packets if not isinstance(packet, EarlySample)]


def without(message: ContactMessage, *names: str) -> dict[str, object]:
    return {name: value for name, value in essence(message).items() if name not in names}


def test_tap_with_rates_meets_the_goal_and_holding_is_no_worse() -> None:
    """0.06 N rms is the goal for six pads (lab/results/now.md); one pad alone may miss it by a quarter."""
    facts = {name: one.facts() for name, one in bench.measure(2, 1, 1.0, (hold, tap(50e-3)), early=True).items()}
    assert facts["tap in 50 ms"]["read_carried_n"] < 0.075
    assert facts["hold"]["ratio"] < 1.05
    assert all(one["wrong"] == one["negative"] == 0 for one in facts.values())


def test_frames_are_bit_identical_with_early_samples(model: ContactModel) -> None:
    packets = sent_of(tapped, 0.4)
    with_early, alone = pipeline_with(model), pipeline_with(model)
    for packet in packets:
        message = answer(with_early, packet)
        if not isinstance(packet, EarlySample):
            assert message is not None
            frame = answer(alone, packet)
            assert frame is not None
            assert without(message, "seq", "now") == without(frame, "seq", "now")


def test_pad_that_publishes_frames_uses_no_other_sample(model: ContactModel) -> None:
    packets, of_frames = sent_of(tapped, 0.3), Lead(LEAD.frame_s)
    with_early, alone = (messages_of(pipeline_with(model, of_frames), some) for some in (packets, frames_only(packets)))
    assert [essence(one) for one in with_early] == [essence(one) for one in alone]
    assert any(one.now is not None for one in alone)


def test_early_samples_change_only_now(model: ContactModel) -> None:
    pipeline, last, early = pipeline_with(model), None, 0
    for packet in sent_of(tapped, 0.4):
        message = answer(pipeline, packet)
        if isinstance(packet, EarlySample) and message is not None and last is not None:
            early += 1
            assert message.seq == last.seq + 1
            assert without(message, "seq", "now") == without(last, "seq", "now")
            assert message.now is not None
            assert last.now is None or last.now.t_ns <= message.now.t_ns
        last = message or last
    assert early > 0.9 * 3 * 0.35 * RATE_HZ


def test_sample_that_comes_twice_late_or_after_its_frame_changes_nothing(model: ContactModel) -> None:
    packets = sent_of(tapped, 0.4)
    doubled: list[Sent] = []
    for number, packet in enumerate(packets):
        doubled.append(packet)
        if isinstance(packet, EarlySample):
            doubled.append(packet)
        older = packets[number - 12]
        if number > 12 and isinstance(older, EarlySample):
            doubled.append(older)
    assert [essence(one) for one in messages_of(pipeline_with(model), doubled)] == [
        essence(one) for one in messages_of(pipeline_with(model), packets)
    ]


def test_lost_sample_is_taken_from_its_frame_or_not_at_all(model: ContactModel) -> None:
    packets = sent_of(tapped, 0.4)
    lost = [packet for number, packet in enumerate(packets) if number % 3 or not isinstance(packet, EarlySample)]
    whole, partly = (messages_of(pipeline_with(model), some) for some in (packets, lost))
    assert len(partly) > 0.7 * len(whole)
    at = {message.now.t_ns: message.now.force_n for message in whole if message.now is not None}
    off = [abs(at[one.now.t_ns] - one.now.force_n) for one in partly if one.now is not None and one.now.t_ns in at]
    assert len(off) > 200
    assert max(off) < 0.15


@pytest.mark.parametrize("axis", range(3))
def test_contradicting_sample_stops_now_until_frames_restart_it(model: ContactModel, axis: int) -> None:
    pipeline, packets = pipeline_with(model), sent_of(pressed, 0.6)
    jumped, before, after = False, list[ContactMessage](), list[ContactMessage]()
    for number, packet in enumerate(packets):
        spoiled = packet
        if number > 400 and not jumped and isinstance(packet, EarlySample) and packet.sensor == 1:
            counts = list(packet.counts)
            counts[axis] += 66
            spoiled, jumped = replace(packet, counts=(counts[0], counts[1], counts[2])), True
        message = answer(pipeline, spoiled)
        if message is not None:
            (after if jumped else before).append(message)
    assert all(message.now is not None for message in before[-100:])
    assert after[0].now is None
    touched = [one.now for one in after if one.now is not None]
    assert len(touched) > 50
    assert all(abs(now.force_n - 0.8) < 0.15 for now in touched)


def test_shear_is_published_between_frames() -> None:
    config = msgspec.structs.replace(CONFIG, contact=ContactConfig(model="shear"))
    pipeline, told = pipeline_with(load_contact_model(config)), list[float]()
    for packet in sent_of(pressed, 0.3):
        message = answer(pipeline, packet)
        if isinstance(packet, EarlySample) and message is not None and message.now is not None:
            told += [] if message.now.shear_x_n is None else [message.now.shear_x_n]
    assert len(told) > 50
    assert max(abs(shear_n) for shear_n in told) < 0.5


def test_saturated_sample_is_left_to_its_frame(model: ContactModel) -> None:
    pipeline = pipeline_with(model)
    packets = sent_of(pressed, 0.5)
    for packet in packets[:-20]:
        answer(pipeline, packet)
    early = next(packet for packet in packets[-20:] if isinstance(packet, EarlySample))
    assert pipeline.early(replace(early, counts=(-4096, 0, 0))) is None
    assert pipeline.early(replace(early, sensor=7)) is None
    assert pipeline.early(replace(early, device_time_us=early.device_time_us + 50_000)) is None
    assert pipeline.early(early) is not None


def test_after_a_silence_samples_wait_for_a_frame(model: ContactModel) -> None:
    pipeline, packets = pipeline_with(model), sent_of(pressed, 0.5)
    for packet in packets[:-20]:
        answer(pipeline, packet)
    pipeline.absent("stale", "silent")
    assert all(pipeline.early(packet) is None for packet in packets[-20:] if isinstance(packet, EarlySample))


@pytest.mark.parametrize("begins", [180, 181, 182, 183, 184])
def test_replay_from_any_frame_gives_the_same_now(model: ContactModel, begins: int) -> None:
    """A state is taken before a frame, with samples before it in the filter; the rest must repeat bit for bit."""
    packets = sent_of(tapped, 0.4)
    first = next(n for n in range(begins, len(packets)) if not isinstance(packets[n], EarlySample))
    live = pipeline_with(model)
    messages_of(live, packets[:first])
    content = snapshot(live)
    told = messages_of(live, packets[first:])
    replayed = pipeline_with(model)
    restore(replayed, content)
    assert [essence(one) for one in messages_of(replayed, packets[first:])] == [essence(one) for one in told]
    assert sum(one.now is not None for one in told) > 100


def test_frames_without_early_samples_are_unchanged(model: ContactModel) -> None:
    frames = frames_only(sent_of(tapped, 0.4))
    assert all(one.now is not None for one in messages_of(pipeline_with(model), frames)[30:])


def test_early_samples_agree_in_the_fast_loop(bus: Bus) -> None:  # noqa: F811
    """Frames and samples as a line brings them, several in a read, with a status now and then that Python must read."""

    def told(may_express: bool) -> Told:
        host = Host(CONFIG, simulated_baseline(CONFIG), bus, may_express)
        host.take(encode(hello(4, can_send_early=1)), 10**9)
        pending = b""
        for number, packet in enumerate(sent_of(tapped, 0.4)):
            pending += encode(on_the_wire(packet))
            if number % 150 == 149:
                pending += encode(hello(4, can_send_early=1))
            if number % 7 not in (2, 3):
                host.take(pending, 5 * 10**9 + packet.device_time_us * 1000 + 900_000)
                pending = b""
        if host.lent is not None:
            host.end()
        return host.told

    in_c, in_python = told(True), told(False)
    assert len(in_c.messages) > 400
    assert in_c.expressed > 0.9 * len(in_c.messages)
    assert [essence(one) for one in in_c.messages] == [essence(one) for one in in_python.messages]


def on_the_wire(packet: Sent) -> Early | Sample:
    if isinstance(packet, EarlySample):
        time_us = packet.device_time_us + 1_000_000  # as in sample_of
        return Early(0, packet.sensor, packet.gain_code, time_us, packet.counts)
    return sample_of(packet)
