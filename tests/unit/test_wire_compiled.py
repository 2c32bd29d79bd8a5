"""Samples unpacked in C against the decoder in Python: the same packets and counters, however the stream is cut."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from examples import examples
from fmfts.sensor.frame import WireFrame, bits
from fmfts.sensor.wire import framing
from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.sensor.wire.packets import Early, Packet, Reply, Sample

i16, u16, mask = st.integers(-32768, 32767), st.integers(0, 65535), st.integers(0, 255)
axes = st.tuples(i16, i16, i16)


@st.composite
def samples(draw: st.DrawFn) -> Sample:
    sensors = draw(st.integers(1, 16))
    masks = mask if sensors <= 8 else u16
    return Sample(
        pad_index=draw(st.integers(0, 15)),
        sequence=draw(st.integers(0, 2**32 - 1)),
        time_us=draw(st.integers(0, 2**48 - 1)),
        gain_code=draw(st.integers(0, 7)),
        trigger=draw(st.integers(0, 1)),
        valid=draw(masks),
        fresh=draw(masks),
        temperature_raw=draw(i16),
        counts=np.array(draw(st.lists(i16, min_size=3 * sensors, max_size=3 * sensors)), np.int16).reshape(-1, 3),
        age_us=np.array(draw(st.lists(u16, min_size=sensors, max_size=sensors)), np.uint16),
    )


@st.composite
def lines(draw: st.DrawFn) -> bytes:
    """A packet, one that was damaged on its way, a lone zero, or garbage."""
    early = st.builds(Early, st.integers(0, 15), st.integers(0, 15), st.integers(0, 7), st.integers(0, 2**48 - 1), axes)
    line = bytearray(encode(draw(st.one_of(samples(), early, st.builds(Reply, mask, mask, mask)))))
    kind = draw(st.sampled_from(["whole", "whole", "damaged", "cut", "zero", "garbage"]))
    if kind == "damaged":
        line[draw(st.integers(0, len(line) - 1))] ^= draw(st.integers(1, 255))
    elif kind == "cut":
        del line[draw(st.integers(0, len(line) - 1)) :]
    return {"zero": b"\0", "garbage": draw(st.binary(max_size=300))}.get(kind, bytes(line))


def told(packets: list[Packet], unpacked: list[framing.PackedSample | framing.PackedEarly]) -> list[object]:
    """Every sample and early sample as plain numbers, in order of arrival within its kind."""
    found: list[object] = []
    for one in unpacked:
        if len(one[4]) == 3:
            found.append(one)
            continue
        pad, sequence, time_us, temperature, packed = one
        frame = WireFrame(pad, sequence, time_us, 0, packed, None)
        fixed = (frame.pad_index, frame.sequence, frame.device_time_us, frame.gain_code, temperature)
        masks = frame.valid.tolist(), frame.fresh.tolist()
        found.append((*fixed, *masks, frame.counts.tolist(), frame.age_us.tolist()))
    for packet in packets:
        if isinstance(packet, Early):
            found.append((packet.pad_index, packet.sensor, packet.gain_code, packet.time_us, packet.counts))
        elif isinstance(packet, Sample):
            count = len(packet.counts)
            masks = bits(packet.valid, count).tolist(), bits(packet.fresh, count).tolist()
            fixed = (packet.pad_index, packet.sequence, packet.time_us, packet.gain_code, packet.temperature_raw)
            found.append((*fixed, *masks, packet.counts.tolist(), packet.age_us.tolist()))
    return found


@given(stream=st.lists(lines(), max_size=8).map(b"".join), cuts=st.lists(st.integers(0, 2000), max_size=6))
@examples(200)
def test_streams_are_read_the_same(stream: bytes, cuts: list[int]) -> None:
    edges = sorted({0, len(stream), *(cut for cut in cuts if cut < len(stream))})
    chunks = [stream[a:b] for a, b in itertools.pairwise(edges)]
    compiled, python = Decoder(), Decoder()
    for chunk in chunks:
        unpacked, rest = compiled.leading_samples(chunk)
        packets = compiled.feed(rest)
        assert told(packets, list(unpacked)) == told(python.feed(chunk), [])
    counters = ("crc_errors", "garbage_packets", "garbage_bytes", "foreign_version")
    assert [getattr(compiled, name) for name in counters] == [getattr(python, name) for name in counters]


def test_stream_of_samples_never_reaches_python() -> None:
    sample = Sample(0, 1, 2, 3, 0, 15, 15, 0, np.arange(12, dtype=np.int16).reshape(4, 3), np.zeros(4, np.uint16))
    line = encode(sample)
    decoder = Decoder()
    whole, rest = decoder.leading_samples(line * 3 + line[:10])
    assert (len(whole), rest) == (3, line[:10])
    assert decoder.feed(rest) == []
    completed, rest = decoder.leading_samples(line[10:])
    assert (len(completed), rest) == (1, b"")


def test_early_samples_between_frames_do_not_reach_python_either() -> None:
    sample = Sample(0, 1, 2, 3, 0, 15, 15, 0, np.arange(12, dtype=np.int16).reshape(4, 3), np.zeros(4, np.uint16))
    early = Early(2, 7, 5, 2**40, (-32768, 0, 32767))
    found, rest = Decoder().leading_samples(encode(early) + encode(sample) + encode(early))
    assert rest == b""
    assert found[0] == found[2] == (2, 7, 5, 2**40, (-32768, 0, 32767))
