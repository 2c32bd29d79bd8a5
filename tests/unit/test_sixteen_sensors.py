"""Pads with more sensors than a board carries: the same answers in C and in Python, faults by name, two fingers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from test_pipeline import PERIOD_NS, config_of
from wide_pads import pipeline_with_default_model, with_sensors

from fmfts.bus.encoding import encode
from fmfts.bus.frame_message import frame_message
from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.pipeline.snapshot import restore, snapshot, state_message
from fmfts.sensor import Frame
from fmfts.sensor.frame import WireFrame
from fmfts.sensor.wire.codec import MalformedError, pack, unpack
from fmfts.sensor.wire.framing import Decoder
from fmfts.sensor.wire.framing import encode as encode_packet
from fmfts.sensor.wire.packets import HelloPad, HelloSensor, Sample, Selftest, SelftestSensor, channel_byte
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_recording.file import RecordingWriter
from fmfts_recording.replay import Replay, essence
from fmfts_simulation.array import SimulatedArray
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import steady_finger
from fmfts_simulation.source import Simulated

EIGHT = array_config(seed=3)
SIXTEEN = with_sensors(EIGHT, 16)
APART_M, FORCE_N = 8e-3, 0.8


def lost(frame: Frame, sensor: int) -> Frame:
    valid = frame.valid.copy()
    valid[sensor] = False
    return replace(frame, valid=valid)


def array_pipeline(config: PadConfig, baseline: Any) -> SeveralPipeline:
    made = pipeline_of(config, contact_model_of(config), "boot")
    assert isinstance(made, SeveralPipeline)
    made.use(baseline)
    return made


def two_fingers(config: PadConfig, count: int, angle: float = 0.0) -> list[Frame]:
    """APART_M apart, around a place 1 mm beside the middle. angle: of the line through both, from the x axis."""
    source = SimulatedArray(config)
    x, y = APART_M / 2.0 * np.cos(angle), APART_M / 2.0 * np.sin(angle)
    source.finger = steady_finger(-x, 1e-3 - y, FORCE_N)
    source.second_finger = steady_finger(x, 1e-3 + y, FORCE_N)
    return [frame for step in range(count) for frame in source.poll(step * PERIOD_NS)]


def pressed(config: PadConfig) -> list[Frame]:
    """Frames of a pad with one magnet, under a finger that rests."""
    source = Simulated(config)
    source.finger = steady_finger(1e-3, -2e-3, FORCE_N)
    return [frame for step in range(100) for frame in source.poll(step * PERIOD_NS)]


@pytest.mark.parametrize("sensors", [9, 12, 16])
def test_many_sensors_track_one_magnet_within_deviations(sensors: int) -> None:
    config = with_sensors(config_of(3), sensors)
    pipeline = pipeline_with_default_model(config, simulated_baseline(config))
    messages = [pipeline.process(frame) for frame in pressed(config)]
    for message in messages[20:]:
        assert (message.health, message.sensors_ok) == ("ok", (1 << sensors) - 1)
        assert message.force_n is not None
        assert message.force_sd_n is not None
        assert abs(message.force_n - FORCE_N) < 5.0 * message.force_sd_n


def test_silent_twelfth_sensor_of_one_magnet_is_named_and_others_track() -> None:
    config = with_sensors(config_of(3), 12)
    pipeline = pipeline_with_default_model(config, simulated_baseline(config))
    frames = pressed(config)
    message = [pipeline.process(lost(frame, 11)) for frame in frames][-1]
    assert (message.health, message.sensors_ok, message.reason) == ("degraded", 0x7FF, "sensor 12 is silent: left out")
    assert message.force_n == pytest.approx(FORCE_N, abs=0.1)


@pytest.mark.long
def test_sixteen_sensors_tell_near_fingers_apart_more_often_than_eight_do() -> None:
    told = []
    for config in (array_config(seed=1), with_sensors(array_config(seed=1), 16)):
        baseline = simulated_baseline(config)
        counts = []
        for angle in np.linspace(0.0, np.pi, 6, endpoint=False).tolist():
            made = array_pipeline(config, baseline)
            message = [made.process(frame) for frame in two_fingers(config, 12, angle)][-1]
            counts.append(len(message.contacts) if isinstance(message.contacts, list) else 0)
        told.append(counts.count(2))
    assert told == [3, 6]


@pytest.mark.long
def test_sixteen_sensors_place_two_near_fingers_better_than_eight_do() -> None:
    off, deviation = [], []
    for config in (EIGHT, SIXTEEN):
        made = array_pipeline(config, simulated_baseline(config))
        message = [made.process(frame) for frame in two_fingers(config, 24)][-1]
        assert isinstance(message.contacts, list)
        assert message.health == "ok"
        one, other = sorted(message.contacts, key=lambda finger: finger.x_m)
        off.append(max(abs(one.x_m + APART_M / 2.0), abs(other.x_m - APART_M / 2.0)))
        deviation.append(max(one.x_sd_m, other.x_sd_m))
    assert off[1] < 0.6 * off[0]
    assert deviation[1] < 0.8 * deviation[0]


def test_silent_thirteenth_sensor_is_named_beside_two_fingers() -> None:
    made = array_pipeline(SIXTEEN, simulated_baseline(SIXTEEN))
    message = [made.process(lost(frame, 12)) for frame in two_fingers(SIXTEEN, 24)][-1]
    assert (message.health, message.sensors_ok, message.reason) == ("degraded", 0xEFFF, "sensor 13 is silent")
    assert isinstance(message.contacts, list)
    assert len(message.contacts) == 2


def test_recording_of_sixteen_sensors_is_replayed_bit_for_bit(tmp_path: Path) -> None:
    path, baseline = tmp_path / "wide.mcap", simulated_baseline(SIXTEEN)
    made, said = array_pipeline(SIXTEEN, baseline), []
    frames = two_fingers(SIXTEEN, 60)
    for frame in frames[:20]:
        made.process(frame)
    writer = RecordingWriter(path)
    writer.add("state", SIXTEEN.name, msgspec.to_builtins(state_message(made, SIXTEEN, "boot")))
    for frame in frames[20:]:
        recorded = frame_message(frame, SIXTEEN.name, "boot", 1)
        writer.add("frame", SIXTEEN.name, msgspec.to_builtins(recorded))
        said.append(made.process(frame))
        writer.add("contact", SIXTEEN.name, msgspec.msgpack.decode(encode(said[-1])))
    writer.finish()
    writer.close()
    assert [essence(one) for one in Replay(path).contacts()] == [essence(one) for one in said]
    assert all(isinstance(one, ContactMessage) and one.sensors_ok == 0xFFFF for one in said)


def test_memory_of_twelve_sensors_continues_bit_identically() -> None:
    config = with_sensors(config_of(3), 12)
    baseline, frames = simulated_baseline(config), pressed(config)
    live, later = (pipeline_with_default_model(config, baseline) for _ in range(2))
    for frame in frames[:50]:
        live.process(frame)
    restore(later, snapshot(live))
    for frame in frames[50:]:
        assert essence(later.process(frame)) == essence(live.process(frame))


# Packets


def wide_sample(sensors: int) -> Sample:
    counts = np.arange(3 * sensors, dtype=np.int16).reshape(sensors, 3)
    every = (1 << sensors) - 1
    return Sample(
        0, 7, 2**40, 3, 0, every & ~(1 << 12), every & ~(1 << 8), 99, counts, np.arange(sensors, dtype=np.uint16)
    )


@pytest.mark.parametrize("sensors", [9, 15, 16])
def test_frame_of_many_sensors_is_read_from_its_packet(sensors: int) -> None:
    sample = wide_sample(sensors)
    decoder = Decoder()
    found, rest = decoder.leading_samples(encode_packet(sample))
    (packet,) = decoder.feed(rest) or [unpack(pack(sample))]
    assert isinstance(packet, Sample)
    assert (packet.valid, packet.fresh) == (sample.valid, sample.fresh)
    for pad_index, sequence, time_us, _, packed in found:
        frame = WireFrame(pad_index, sequence, time_us, 0, packed, None)  # type: ignore[arg-type]
        assert np.array_equal(frame.counts, sample.counts)
        assert np.flatnonzero(~frame.valid).tolist() == [12] * (sensors > 12)
        assert np.flatnonzero(~frame.fresh).tolist() == [8]


def test_frame_of_eight_sensors_has_the_bytes_that_boards_send() -> None:
    eight, nine = (pack(wide_sample(sensors)) for sensors in (8, 9))
    assert (len(eight), eight[1] >> 4) == (17 + 8 * 8, 8)
    assert (len(nine), nine[1] >> 4) == (17 + 9 * 8 + 2, 9)


@pytest.mark.parametrize("body", [pack(wide_sample(9))[: 17 + 8 * 8] + b"\0\0", pack(wide_sample(16)) + bytes(8)])
def test_wide_packet_of_eight_or_of_seventeen_sensors_is_refused(body: bytes) -> None:
    with pytest.raises(MalformedError, match="sensors: more than 8, at most 16"):
        unpack(body)


def test_selftest_of_sixteen_sensors_survives_the_line() -> None:
    sensors = tuple(SelftestSensor(0, (one, 2, 3), (-one, -2, -3)) for one in range(16))
    (found,) = Decoder().feed(encode_packet(Selftest(1, 2, 5, sensors)))
    assert found == Selftest(1, 2, 5, sensors)


def test_probe_and_state_name_each_sensors_mux() -> None:
    ways = [(0x77, 3), (0x70, 3), (0x71, 7)]
    pad = HelloPad(1, 0x77, tuple(HelloSensor(channel_byte(0x77, *way), 0, b"H43") for way in ways))
    assert [pad.way_to(sensor) for sensor in range(3)] == ways
    assert pad.muxes == [0x70, 0x71, 0x77]
    assert pad.sensors[0].channel == 3  # like the channel of a pad with one mux
