"""The wire's Python side against the golden vectors and against everything that can go wrong on a line."""

from __future__ import annotations

import itertools
import runpy
from configparser import ConfigParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from wire_packets import make_sample, packets

from fmfts.sensor.wire.codec import pack
from fmfts.sensor.wire.framing import MAX_LINE_BYTES, Decoder, encode
from fmfts.sensor.wire.packets import (
    Early,
    Hello,
    HelloPad,
    HelloSensor,
    Load,
    Packet,
    Reply,
    Request,
    Selftest,
    SelftestSensor,
    Status,
    StatusPad,
)

DATA = Path(__file__).parents[1] / "data"
VECTORS = ConfigParser()
VECTORS.read(DATA / "wire_vectors.ini")


def by_sensor(numbers: list[int], width: int = 3) -> list[tuple[int, ...]]:
    return [tuple(numbers[i : i + width]) for i in range(0, len(numbers), width)]


def by_pad(numbers: list, sensor_counts: list[int]) -> list[list]:
    remaining = iter(numbers)
    return [[next(remaining) for _ in range(count)] for count in sensor_counts]


def packet_of(section: str) -> Packet:
    """The vector's fields as a packet, read from the text and nothing else."""
    text = VECTORS[section]
    lists = {key: [int(word, 0) for word in text[key].split()] for key in text if key not in ("type", "line")}
    v = {key: numbers[0] for key, numbers in lists.items()}
    settings = ("gain_code", "trigger")
    match text["type"]:
        case "sample":
            names = ("pad_index", "sequence", "time_us", *settings, "valid", "fresh", "temperature_raw")
            return make_sample(by_sensor(lists["counts"]), lists["age_us"], **{name: v[name] for name in names})
        case "hello":
            identification = [bytes(one) for one in by_sensor(lists["identification"])]
            sensors = [HelloSensor(*one) for one in zip(lists["channel"], lists["state"], identification, strict=True)]
            pads = zip(lists["i2c_port"], lists["mux_address"], by_pad(sensors, lists["sensor_count"]), strict=True)
            return Hello(
                tuple(lists["firmware_version"]),
                v["reset_cause"],
                v["clock"],
                bytes(lists["uid"]),
                v["rate_hz"],
                *(v[name] for name in settings),
                v["running"],
                tuple(HelloPad(port, mux, tuple(group)) for port, mux, group in pads),
                v["can_send_early"],
                v["can_make_pads"],
            )
        case "status":
            counters = zip(*(lists[key] for key in ("bus_errors", "bus_recoveries", "config_repairs")), strict=True)
            states = by_pad(lists["state"], lists["sensor_count"])
            pads = tuple(StatusPad(*c, tuple(s)) for c, s in zip(counters, states, strict=True))
            return Status(v["time_us"], v["transmit_dropped"], v["receive_errors"], pads)
        case "reply":
            return Reply(v["request_id"], v["request_type"], v["result"])
        case "load":
            return Load(v["sequence"], v["time_us"], v["counts"])
        case "early":
            return Early(v["pad_index"], v["sensor"], v["gain_code"], v["time_us"], tuple(lists["counts"]))
        case "selftest":
            readings = zip(lists["state"], by_sensor(lists["positive"]), by_sensor(lists["negative"]), strict=True)
            sensors = tuple(SelftestSensor(*one) for one in readings)
            return Selftest(v["request_id"], v["pad_index"], v["gain_code"], sensors)
        case "request":
            return Request(v["request_type"], v["request_id"], v["pad_index"], v["argument"])
    raise AssertionError(text["type"])


def facts(packet: Packet) -> tuple:
    """All fields of a packet as plain values, so that samples compare too."""
    values = [getattr(packet, name) for name in packet.__struct_fields__]
    return type(packet), *(value.tolist() if isinstance(value, np.ndarray) else value for value in values)


def test_vectors_are_what_the_independent_encoder_writes() -> None:
    made = runpy.run_path(str(DATA / "make_wire_vectors.py"))
    assert {name: made["line"](*vector).hex() for name, vector in made["VECTORS"].items()} == {
        name: VECTORS[name]["line"] for name in VECTORS.sections()
    }


@pytest.mark.parametrize("section", VECTORS.sections())
def test_golden_vector_decodes_to_its_fields_and_encodes_to_its_bytes(section: str) -> None:
    line = bytes.fromhex(VECTORS[section]["line"])
    (decoded,) = Decoder().feed(line)
    assert facts(decoded) == facts(packet_of(section))
    assert encode(packet_of(section)) == line


@given(packets)
def test_every_packet_survives_the_line(packet: Packet) -> None:
    line = encode(packet)
    assert line.count(0) == 1
    assert line[-1] == 0
    assert len(line) <= MAX_LINE_BYTES + 1
    assert [facts(one) for one in Decoder().feed(line)] == [facts(packet)]


@given(st.lists(packets, max_size=5), st.lists(st.integers(0, 2000)))
def test_stream_may_be_cut_anywhere(sent: list[Packet], cuts: list[int]) -> None:
    stream = b"\0".join(encode(packet) for packet in sent)
    edges = [0, *sorted(cuts), len(stream)]
    decoder = Decoder()
    received = [packet for a, b in itertools.pairwise(edges) for packet in decoder.feed(stream[a:b])]
    assert [facts(packet) for packet in received] == [facts(packet) for packet in sent]
    assert (decoder.crc_errors, decoder.garbage_packets, decoder.garbage_bytes) == (0, 0, 0)


@given(st.lists(st.tuples(st.binary(max_size=600), packets), min_size=1, max_size=4))
def test_garbage_costs_only_the_packet_that_it_touches(stretches: list[tuple[bytes, Packet]]) -> None:
    """Garbage that a zero ends costs nothing; what runs into a packet costs that packet and no other."""
    decoder = Decoder()
    for garbage, packet in stretches:
        survivors = [facts(one) for one in decoder.feed(garbage + b"\0" + encode(packet))]
        assert survivors[-1] == facts(packet)
        torn = [facts(one) for one in decoder.feed(garbage + encode(packet) + encode(packet))]
        assert torn[-1] == facts(packet)


@given(packets, packets, st.data())
def test_garbage_inside_a_packet_costs_that_packet_alone(hit: Packet, next_one: Packet, data: st.DataObject) -> None:
    line = encode(hit)
    place = data.draw(st.integers(0, len(line) - 1))
    garbage = data.draw(st.binary(min_size=1, max_size=300))
    received = Decoder().feed(line[:place] + garbage + line[place:] + encode(next_one))
    assert facts(received[-1]) == facts(next_one)
    # If a zero is inserted at the line's very end, or a CRC matches by chance (2^-16), the packet may survive.
    assert len(received) <= 2


@given(packets, st.data())
def test_no_packet_with_one_wrong_bit_is_accepted(packet: Packet, data: st.DataObject) -> None:
    """CRC-16/CCITT finds every single-bit error; COBS code bytes hit instead tear the packet or its length."""
    line = bytearray(encode(packet))
    byte = data.draw(st.integers(0, len(line) - 2))
    line[byte] ^= 1 << data.draw(st.integers(0, 7))
    decoder = Decoder()
    decoder.feed(b"\0")
    received = decoder.feed(bytes(line))
    assert received == []
    assert decoder.crc_errors + decoder.garbage_packets >= 1


@given(packets, st.integers(0, 2**16 - 1))
def test_no_packet_with_a_wrong_crc_is_accepted(packet: Packet, crc: int) -> None:
    encoder = runpy.run_path(str(DATA / "make_wire_vectors.py"))
    body = pack(packet)
    if crc == encoder["crc"](body):
        crc ^= 1
    decoder = Decoder()
    assert decoder.feed(b"\0" + encoder["cobs"](body + crc.to_bytes(2, "little")) + b"\0") == []
    assert decoder.crc_errors == 1


def framed(body: bytes) -> bytes:
    encoder = runpy.run_path(str(DATA / "make_wire_vectors.py"))
    return encoder["cobs"](body + encoder["crc"](body).to_bytes(2, "little")) + b"\0"


@pytest.mark.parametrize("section", VECTORS.sections())
def test_length_that_the_type_does_not_allow_is_garbage(section: str) -> None:
    body = pack(packet_of(section))
    decoder = Decoder()
    decoder.feed(b"\0")
    lines = [framed(body[:size]) for size in range(1, len(body))] + [framed(body + b"\1")]
    assert decoder.feed(b"".join(lines)) == []
    assert decoder.garbage_packets == len(lines)
    assert decoder.crc_errors == 0


def test_packet_of_another_wire_version_is_no_garbage() -> None:
    decoder = Decoder()
    assert decoder.feed(b"\0" + framed(b"\x21 anything at all")) == []
    assert decoder.foreign_version == 2
    assert (decoder.garbage_packets, decoder.crc_errors) == (0, 0)


@pytest.mark.parametrize("packet_type", [0, 6, 7])
def test_unknown_type_is_garbage(packet_type: int) -> None:
    decoder = Decoder()
    assert decoder.feed(b"\0" + framed(bytes([0x10 | packet_type, 1, 2]))) == []
    assert decoder.garbage_packets == 1


def test_line_that_never_ends_is_counted_but_not_kept() -> None:
    decoder = Decoder()
    decoder.feed(b"\0")
    for _ in range(100):
        assert decoder.feed(b"\xff" * 1000) == []
    assert decoder.feed(b"\0") == []
    assert (decoder.garbage_packets, decoder.garbage_bytes) == (1, 100_000)
    good = packet_of("sample_rest")
    assert [facts(packet) for packet in decoder.feed(encode(good))] == [facts(good)]


def test_joining_in_the_middle_of_a_packet_is_no_error() -> None:
    line = encode(packet_of("sample_rest"))
    decoder = Decoder()
    assert len(decoder.feed(line[20:] + line)) == 1
    assert (decoder.crc_errors, decoder.garbage_packets) == (0, 0)
