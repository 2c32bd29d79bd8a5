"""The rig that measures latency: its numbers must belong to the frames that it names."""

from __future__ import annotations

import struct

import msgspec
import numpy as np

from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.sensor.wire.packets import Sample
from fmfts_lab.bench.latency import pad_of
from fmfts_lab.bench.latency_rig import NUMBERS, RATE_HZ, RAW_PER_K, ROOM_C, repeated, samples
from fmfts_lab.bench.latency_run import WARM_UP_S, lateness, matched


def test_boards_number_their_frames_in_the_temperature() -> None:
    heard = Decoder().feed(b"".join(encode(sample) for sample in samples(pad_of(0), 0.5)))
    assert all(isinstance(sample, Sample) for sample in heard)
    numbers = [(s.sequence, s.temperature_raw) for s in heard if isinstance(s, Sample)]
    assert numbers == [(number, number % NUMBERS) for number in range(RATE_HZ // 2)]


def test_repeated_cycle_goes_on_as_one_stream() -> None:
    cycle = samples(pad_of(0), 0.5)
    stream = [repeated(cycle, number) for number in range(3 * len(cycle))]
    assert [sample.sequence for sample in stream] == list(range(len(stream)))
    periods_us = np.diff([sample.time_us for sample in stream])
    assert (np.abs(periods_us * RATE_HZ - 1e6) < 0.5e6).all()  # chips that run free: frames follow their conversions


def test_messages_find_their_frames_though_some_are_lost() -> None:
    frames = round((WARM_UP_S + 1.0) * RATE_HZ)
    written = 1_000_000_000 + np.arange(frames, dtype=np.int64)[None] * round(1e9 / RATE_HZ)
    delay_ns = 700_000_000  # many periods: the newest frame is not the one that a message describes
    kept = [number for number in range(frames) if number % 7]
    daemon = [
        (
            b"contact/p0",
            int(written[0, number]) + delay_ns,
            msgspec.msgpack.encode(
                {
                    "temperature_c": ROOM_C + number % NUMBERS / RAW_PER_K,
                    "t_publish_ns": int(written[0, number]) + 20_000_000,
                    "t_sample_ns": int(written[0, number]) - 3_000_000,
                }
            ),
        )
        for number in kept
    ]
    publish, arrive, age = matched(daemon, written, is_echo=False)
    measured = [number for number in kept if written[0, number] >= written[0, 0] + round(WARM_UP_S * 1e9)]
    assert len(publish) == len(measured)
    assert set(publish) == {20_000_000}
    assert set(arrive) == {delay_ns}
    assert set(age) == {3_000_000}
    echoed = [
        (topic, at, struct.pack("<qq", number, at - 5_000_000))
        for (topic, at, _), number in zip(daemon, kept, strict=True)
    ]
    assert set(matched(echoed, written, is_echo=True)[0]) == {delay_ns - 5_000_000}


def test_measured_delay_of_frames_includes_the_boards() -> None:
    pads, frames = 4, round((WARM_UP_S + 1.0) * RATE_HZ)
    due = 1_000_000_000 + (np.arange(frames) + np.arange(pads)[:, None] / pads) * 1e9 / RATE_HZ
    held = due.astype(np.int64)
    held[:, -10:] += 3_000_000
    late = lateness(held)
    assert late.size == (held >= held.min() + round(WARM_UP_S * 1e9)).sum()
    assert np.abs(np.sort(late)[-10 * pads :] - 3_000_000).max() <= 2
    assert late.min() <= 2
