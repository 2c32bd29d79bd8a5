"""What the firmware's ELF sends from the emulated chip, in the board's own time.

`make test-firmware-long` runs the same for 30 s of it.
"""

from __future__ import annotations

import os
from itertools import pairwise

import numpy as np
import pytest
from emulated_stream import EVERYONE, EmulatedStream

from emulator.chips import SINGLE_CONVERSION_S
from fmfts.pipeline.configured import READ_S
from fmfts.sensor.wire.packets import (
    EARLY_BYTES,
    LINE_BITS_PER_BYTE,
    Early,
    Reply,
    Result,
    Sample,
    Selftest,
    Verb,
)

SECONDS = float(os.environ.get("FMFTS_EMULATED_SECONDS", "2"))
AGE_TOLERANCE_S = 0.5e-3  # the required bound; a conversion takes 4.5 ms
STEP_S = 0.25e-3
HSE, HSI = 1, 2
POWER_ON = 1

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")


def started(**options: object) -> EmulatedStream:
    """Streaming, settled, every conversion numbered."""
    stream = EmulatedStream(**options)
    for sensors in stream.board.sensors:
        for sensor in sensors:
            sensor.number_conversions = True
    stream.run(0.5)
    return stream


def conversion_number(sample: Sample, sensor: int) -> int:
    return int(sample.counts[sensor][0]) << 10 | int(sample.counts[sensor][1])


def test_each_free_conversion_is_sampled_once_with_its_true_age() -> None:
    stream = started()
    samples = stream.samples(SECONDS)
    assert len(samples) / SECONDS >= 219
    assert [b.sequence - a.sequence for a, b in pairwise(samples)] == [1] * (len(samples) - 1)
    offset_s = stream.board.now_s - stream.clock_us() * 1e-6
    for sensor, chip in enumerate(stream.board.sensors[0]):
        assert all(sample.valid >> sensor & 1 for sample in samples)
        numbers = [conversion_number(sample, sensor) for sample in samples]
        fresh = [number for number, sample in zip(numbers, samples, strict=True) if sample.fresh >> sensor & 1]
        assert all(b > a for a, b in pairwise(fresh)), "delivered twice as fresh"
        stale = [b - a for (a, b), s in zip(pairwise(numbers), samples[1:], strict=True) if not s.fresh >> sensor & 1]
        assert not any(stale), "a new conversion was not called fresh"
        # A frame has room for one sample of each sensor; if two conversions were read since the last frame, the newer
        # one is sent. It never happens twice in a row.
        assert max(b - a for a, b in pairwise(fresh)) <= 2, "lost"
        ended_s = [(sample.time_us - int(sample.age_us[sensor])) * 1e-6 + offset_s for sample in samples]
        errors_s = np.array(ended_s) - np.array([chip.ended_s[number] for number in numbers])
        assert np.abs(errors_s).max() < AGE_TOLERANCE_S
    assert stream.is_clean()


def test_no_conversion_of_sensor_slower_than_the_frames_is_lost() -> None:
    stream = started(chip_ppm=(10_000, 15_000, 20_000, 30_000))
    samples = stream.samples(1.0)
    for sensor in range(4):
        fresh = [conversion_number(sample, sensor) for sample in samples if sample.fresh >> sensor & 1]
        assert fresh == list(range(fresh[0], fresh[-1] + 1))


def test_every_sample_comes_before_its_frame_and_soon_after_its_conversion() -> None:
    """The line carries one pad's samples and frames; the daemon assumes READ_S and the line's time."""
    stream = started()
    assert stream.request(Verb.START, 0b001).result == Result.DONE
    stream.run(0.1)
    offset_s, late_s = stream.board.now_s - stream.clock_us() * 1e-6, list[float]()
    seen: dict[int, set[int]] = {sensor: set() for sensor in range(4)}
    for step in range(1000):
        for packet in stream.run(STEP_S):
            if isinstance(packet, Early):
                number = packet.counts[0] << 10 | packet.counts[1]
                assert number not in seen[packet.sensor]
                seen[packet.sensor].add(number)
                late_s.append(stream.board.now_s - STEP_S / 2 - (packet.time_us * 1e-6 + offset_s))
            elif isinstance(packet, Sample) and step > 50:
                assert all(conversion_number(packet, sensor) in seen[sensor] for sensor in range(4))
    rate_hz = len(late_s) / (1000 * STEP_S)
    assert 4 * 210 < rate_hz < 4 * 230
    expected_s = READ_S + EARLY_BYTES * LINE_BITS_PER_BYTE / 460800
    assert abs(np.median(late_s) - expected_s) < 0.3e-3
    stream.run(1.1)
    assert stream.status.transmit_dropped == 0
    assert stream.is_clean()


def simultaneous() -> EmulatedStream:
    stream = started()
    assert stream.request(Verb.TRIGGER, 1).result == Result.DONE
    stream.request(Verb.RATE, 160)
    stream.run(0.2)
    return stream


def test_simultaneous_conversions_start_together_on_every_sensor_150_times_a_second() -> None:
    stream = simultaneous()
    samples = stream.samples(SECONDS)
    assert len(samples) / SECONDS >= 150
    assert [b.sequence - a.sequence for a, b in pairwise(samples)] == [1] * (len(samples) - 1)
    for sample in samples:
        assert sample.valid == sample.fresh == EVERYONE
        starts_s = [
            chip.ended_s[conversion_number(sample, i)] - SINGLE_CONVERSION_S * (1 + chip.clock_error)
            for i, chip in enumerate(stream.board.sensors[0])
        ]
        assert max(starts_s) - min(starts_s) < 30e-6
    assert stream.is_clean()


def test_two_runs_send_the_same_bytes() -> None:
    first, second = EmulatedStream(pads=3), EmulatedStream(pads=3)
    for stream in (first, second):
        stream.run(0.2)
        stream.board.unplug(0, 1)
        stream.run(0.2)
    assert len(first.raw) > 10_000
    assert first.raw == second.raw


def test_three_pads_stream_side_by_side_without_a_gap() -> None:
    stream = EmulatedStream(pads=3)
    stream.run(0.5)
    begun = len(stream.packets)
    stream.run(SECONDS / 2)
    samples = [packet for packet in stream.packets[begun:] if isinstance(packet, Sample)]
    for pad in range(3):
        sequences = [sample.sequence for sample in samples if sample.pad_index == pad]
        assert len(sequences) >= 219 * SECONDS / 2
        assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
    assert stream.is_clean()


def test_field_arrives_as_counts_of_the_range_in_force() -> None:
    stream = EmulatedStream()
    field_t = np.arange(12).reshape(4, 3) * 1e-5 - 5e-5
    stream.board.set_field(0, field_t)
    stream.run(0.3)
    assert np.array_equal(stream.latest(Sample).counts, np.round(field_t * 1e4 * 660))  # ±2.5 G: 660 counts per gauss
    assert stream.request(Verb.RANGE, 5).result == Result.DONE
    stream.run(0.2)
    assert np.array_equal(stream.latest(Sample).counts, np.round(field_t * 1e4 * 390))


def test_hello_after_power_on_reports_cause_crystal_and_unique_id() -> None:
    uid = bytes(range(0x30, 0x3C))
    stream = EmulatedStream(uid=uid)
    stream.run(0.3)
    hello = stream.hello
    assert (hello.reset_cause, hello.clock, hello.uid) == (POWER_ON, HSE, uid)
    assert [sensor.identification for sensor in hello.pads[0].sensors] == [b"H43"] * 4


def test_board_without_its_crystal_says_so_and_streams_from_internal_clock() -> None:
    stream = EmulatedStream(hse_ok=False)
    stream.run(0.5)
    assert stream.hello.clock == HSI
    assert len(stream.samples(0.5)) >= 109
    assert stream.is_clean()


def test_selftest_measures_the_bias_strap() -> None:
    stream = EmulatedStream()
    stream.run(0.3)
    assert stream.request(Verb.SELFTEST, pad=0).result == Result.DONE
    stream.wait(lambda packet: isinstance(packet, Selftest), 0.5)
    for sensor in stream.latest(Selftest).sensors:
        assert sensor.state == 0
        assert sensor.positive == (452, 452, 421)  # 1.16, 1.16, 1.08 G at 390 counts per gauss
    stream.wait_until_whole()


@pytest.mark.parametrize("damage", ["crc", "length", "endless"])
def test_damaged_request_is_counted_and_not_answered(damage: str) -> None:
    stream = EmulatedStream()
    stream.run(0.3)
    good = bytes((7, 0x18, 1, 255, 1, 1, 1))  # filler that is never a request
    line = {"crc": good[:-1] + b"\x05\0", "length": b"\3\x18\1\0", "endless": b"\x20" * 400 + b"\0"}[damage]
    before = len(stream.packets)
    stream.board.send(line)
    stream.run(0.1)
    assert not any(isinstance(packet, Reply) for packet in stream.packets[before:])
    assert stream.request(Verb.STATUS).result == Result.DONE
    stream.run(0.02)
    assert stream.status.receive_errors == 1
    assert stream.is_clean()
