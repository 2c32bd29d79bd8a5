"""The load cell on the emulated chip's spare pins: read within the data sheet's times, and no frame is lost to it."""

from __future__ import annotations

from itertools import pairwise

import pytest
from emulated_stream import EVERYONE, EmulatedStream

from fmfts.sensor.wire.packets import Load, Sample

SECONDS = 1.0

pytestmark = pytest.mark.needs("arm-none-eabi-gcc")


def frames_and_loads(counts: int | None) -> tuple[list[Sample], list[Load], EmulatedStream]:
    stream = EmulatedStream()
    stream.board.converter.counts = counts
    stream.run(0.5)
    packets = stream.run(SECONDS)
    frames = [packet for packet in packets if isinstance(packet, Sample)]
    return frames, [packet for packet in packets if isinstance(packet, Load)], stream


def test_load_cell_streams_beside_the_frames() -> None:
    counts = -(2**22) - 7
    without, nothing, _ = frames_and_loads(None)
    frames, loads, stream = frames_and_loads(counts)
    assert nothing == []
    assert len(frames) == pytest.approx(len(without), abs=1)
    assert [b.sequence - a.sequence for a, b in pairwise(frames)] == [1] * (len(frames) - 1)
    assert all(frame.valid == EVERYONE for frame in frames)
    assert len(loads) == pytest.approx(80 * SECONDS, abs=1)
    assert {load.counts for load in loads} == {counts}
    assert [b.sequence - a.sequence for a, b in pairwise(loads)] == [1] * (len(loads) - 1)
    # A conversion waits for the sensor's present turn, about 0.4 ms.
    assert max(abs((b.time_us - a.time_us) - 12500) for a, b in pairwise(loads)) < 1000
    assert stream.board.complaints == []
