"""Packs packets to bytes (header and body, firmware/wire.md) and unpacks them; framing.py adds CRC and COBS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from struct import Struct as Layout
from struct import error as LayoutError  # noqa: N812
from typing import Any

import numpy as np

from fmfts.sensor.frame import READING_BYTES
from fmfts.sensor.wire.packets import (
    BOARD_SENSORS,
    MAX_PADS,
    MAX_SENSORS,
    MORE_SENSORS,
    Early,
    Hello,
    HelloPad,
    HelloSensor,
    Load,
    Packet,
    PacketType,
    Reply,
    Request,
    Sample,
    Selftest,
    SelftestSensor,
    Status,
    StatusPad,
    Verb,
)

VERSION = 1
ONE_MASK = 0xFF  # the sensors whose bits fit into the masks that every sample has
EARLY_MORE = 0x08  # the bit of an early sample's sensor beside the gain code

_SAMPLE = Layout("<BBIIHBBBh")
_HELLO = Layout("<B3BBB12sHBB")
_HELLO_PAD = Layout("<BBB")
_HELLO_SENSOR = Layout("<BB3s")
_STATUS = Layout("<BIHIIB")
_STATUS_PAD = Layout("<IIIB")
_REPLY = Layout("<BBBB")
_MORE_MASKS = Layout("<BB")
_SELFTEST = Layout("<BBBB")
_SELFTEST_SENSOR = Layout("<B3h3h")
_LOAD = Layout("<BIIHi")
_EARLY = Layout("<BBBIHhhh")
_REQUEST = Layout("<BBBH")


class MalformedError(ValueError):
    """The bytes are no packet: bad COBS, an unknown type, or a length or a count that the type does not allow."""


def _count(value: int, most: int, what: str) -> int:
    if not 1 <= value <= most:
        raise MalformedError(f"{value} {what}: 1 to {most}")
    return value


def _sensors(told: int, room: int) -> int:
    """The number of sensors in a packet. told: its four bits. room: the number that fits its length."""
    if told != MORE_SENSORS:
        return _count(told, BOARD_SENSORS, "sensors")
    if not BOARD_SENSORS < room <= MAX_SENSORS:
        raise MalformedError(f"bytes for {room} sensors: more than {BOARD_SENSORS}, at most {MAX_SENSORS}")
    return room


def _told(sensors: int) -> int:
    """The four bits for a number of sensors."""
    return sensors if sensors <= BOARD_SENSORS else MORE_SENSORS


def _whole(packet: bytes, end: int) -> None:
    if len(packet) != end:
        raise MalformedError(f"{len(packet)} bytes where {end} are due")


def _records(layout: Layout, packet: bytes, start: int, end: int) -> Iterator[tuple[Any, ...]]:
    return layout.iter_unpack(packet[start:end])


def _unpack_sample(packet: bytes) -> Sample:
    _, pad, sequence, time_low, time_high, flags, valid, fresh, temperature = _SAMPLE.unpack_from(packet)
    sensors = _sensors(pad >> 4, (len(packet) - _SAMPLE.size - _MORE_MASKS.size) // READING_BYTES)
    masks = _SAMPLE.size + READING_BYTES * sensors
    if sensors > BOARD_SENSORS:
        _whole(packet, masks + _MORE_MASKS.size)
        more_valid, more_fresh = _MORE_MASKS.unpack_from(packet, masks)
        valid, fresh = valid | more_valid << BOARD_SENSORS, fresh | more_fresh << BOARD_SENSORS
    else:
        _whole(packet, masks)
    readings = np.frombuffer(packet, "<i2", 4 * sensors, _SAMPLE.size).reshape(sensors, 4)
    return Sample(
        pad & 15,
        sequence,
        time_low | time_high << 32,
        flags & 7,
        flags >> 3 & 1,
        valid,
        fresh,
        temperature,
        readings[:, :3],
        readings[:, 3].view("<u2"),
    )


def _pack_sample(sample: Sample) -> bytes:
    sensors = len(sample.counts)
    readings = np.empty((sensors, 4), "<i2")
    readings[:, :3] = sample.counts
    readings[:, 3] = np.asarray(sample.age_us, "<u2").view("<i2")
    header = _SAMPLE.pack(
        VERSION << 4 | PacketType.SAMPLE,
        sample.pad_index | _told(sensors) << 4,
        sample.sequence,
        sample.time_us & 0xFFFFFFFF,
        sample.time_us >> 32,
        sample.gain_code | sample.trigger << 3,
        sample.valid & ONE_MASK,
        sample.fresh & ONE_MASK,
        sample.temperature_raw,
    )
    more = (sample.valid >> BOARD_SENSORS, sample.fresh >> BOARD_SENSORS)
    return header + readings.tobytes() + (_MORE_MASKS.pack(*more) if sensors > BOARD_SENSORS else b"")


def _unpack_hello(packet: bytes) -> Hello:
    _, *version, cause, clock, uid, rate_hz, settings, pad_count = _HELLO.unpack_from(packet)
    offset = _HELLO.size
    pads = []
    for _ in range(_count(pad_count, MAX_PADS, "pads")):
        port, mux_address, sensor_count = _HELLO_PAD.unpack_from(packet, offset)
        offset += _HELLO_PAD.size
        end = offset + _HELLO_SENSOR.size * _count(sensor_count, MAX_SENSORS, "sensors")
        sensors = tuple(HelloSensor(*fields) for fields in _records(_HELLO_SENSOR, packet, offset, end))
        pads.append(HelloPad(port, mux_address, sensors))
        offset = end
    _whole(packet, offset)
    major, minor, patch = version
    gain_code, trigger, running, early, makes = settings & 7, *(settings >> bit & 1 for bit in (3, 4, 5, 6))
    return Hello(
        (major, minor, patch), cause, clock, uid, rate_hz, gain_code, trigger, running, tuple(pads), early, makes
    )


def _pack_hello(hello: Hello) -> bytes:
    settings = hello.gain_code | hello.trigger << 3 | hello.running << 4
    settings |= hello.can_send_early << 5 | hello.can_make_pads << 6
    header = VERSION << 4 | PacketType.HELLO
    fixed = (*hello.firmware_version, hello.reset_cause, hello.clock, hello.uid, hello.rate_hz, settings)
    parts = [_HELLO.pack(header, *fixed, len(hello.pads))]
    for pad in hello.pads:
        parts.append(_HELLO_PAD.pack(pad.i2c_port, pad.mux_address, len(pad.sensors)))
        parts += [_HELLO_SENSOR.pack(one.channel, one.state, one.identification) for one in pad.sensors]
    return b"".join(parts)


def _unpack_status(packet: bytes) -> Status:
    _, time_low, time_high, dropped, errors, pad_count = _STATUS.unpack_from(packet)
    offset = _STATUS.size
    pads = []
    for _ in range(_count(pad_count, MAX_PADS, "pads")):
        bus_errors, recoveries, repairs, sensor_count = _STATUS_PAD.unpack_from(packet, offset)
        offset += _STATUS_PAD.size
        end = offset + _count(sensor_count, MAX_SENSORS, "sensors")
        pads.append(StatusPad(bus_errors, recoveries, repairs, tuple(packet[offset:end])))
        offset = end
    _whole(packet, offset)
    return Status(time_low | time_high << 32, dropped, errors, tuple(pads))


def _pack_status(status: Status) -> bytes:
    time = (status.time_us & 0xFFFFFFFF, status.time_us >> 32)
    header = VERSION << 4 | PacketType.STATUS
    parts = [_STATUS.pack(header, *time, status.transmit_dropped, status.receive_errors, len(status.pads))]
    for pad in status.pads:
        counters = (pad.bus_errors, pad.bus_recoveries, pad.config_repairs, len(pad.states))
        parts.append(_STATUS_PAD.pack(*counters) + bytes(pad.states))
    return b"".join(parts)


def _unpack_reply(packet: bytes) -> Reply:
    _whole(packet, _REPLY.size)
    return Reply(*_REPLY.unpack(packet)[1:])


def _pack_reply(reply: Reply) -> bytes:
    return _REPLY.pack(VERSION << 4 | PacketType.REPLY, reply.request_id, reply.request_type, reply.result)


def _unpack_selftest(packet: bytes) -> Selftest:
    _, request_id, pad, gain_code = _SELFTEST.unpack_from(packet)
    records = _sensors(pad >> 4, (len(packet) - _SELFTEST.size) // _SELFTEST_SENSOR.size)
    end = _SELFTEST.size + _SELFTEST_SENSOR.size * records
    _whole(packet, end)
    each = _records(_SELFTEST_SENSOR, packet, _SELFTEST.size, end)
    sensors = tuple(SelftestSensor(state, tuple(axes[:3]), tuple(axes[3:])) for state, *axes in each)
    return Selftest(request_id, pad & 15, gain_code, sensors)


def _pack_selftest(selftest: Selftest) -> bytes:
    pad = selftest.pad_index | _told(len(selftest.sensors)) << 4
    header = _SELFTEST.pack(VERSION << 4 | PacketType.SELFTEST, selftest.request_id, pad, selftest.gain_code)
    return header + b"".join(_SELFTEST_SENSOR.pack(one.state, *one.positive, *one.negative) for one in selftest.sensors)


def _unpack_load(packet: bytes) -> Load:
    _whole(packet, _LOAD.size)
    _, sequence, time_low, time_high, counts = _LOAD.unpack(packet)
    return Load(sequence, time_low | time_high << 32, counts)


def _pack_load(load: Load) -> bytes:
    time = (load.time_us & 0xFFFFFFFF, load.time_us >> 32)
    return _LOAD.pack(VERSION << 4 | PacketType.LOAD, load.sequence, *time, load.counts)


def _unpack_early(packet: bytes) -> Early:
    _whole(packet, _EARLY.size)
    _, place, gain_code, time_low, time_high, *counts = _EARLY.unpack(packet)
    x, y, z = counts
    return Early(
        place & 15, place >> 4 & 7 | gain_code & EARLY_MORE, gain_code & 7, time_low | time_high << 32, (x, y, z)
    )


def _pack_early(early: Early) -> bytes:
    place, time = 128 | (early.sensor & 7) << 4 | early.pad_index, (early.time_us & 0xFFFFFFFF, early.time_us >> 32)
    gain_code = early.gain_code | early.sensor & EARLY_MORE
    return _EARLY.pack(VERSION << 4 | PacketType.EARLY, place, gain_code, *time, *early.counts)


def _unpack_request(packet: bytes) -> Request:
    _whole(packet, _REQUEST.size)
    header, request_id, pad_index, argument = _REQUEST.unpack(packet)
    return Request(header & 15, request_id, pad_index, argument)


def _pack_request(request: Request) -> bytes:
    return _REQUEST.pack(VERSION << 4 | request.verb, request.request_id, request.pad_index, request.argument)


_UNPACK: dict[int, Callable[[bytes], Packet]] = {
    PacketType.SAMPLE: _unpack_sample,
    PacketType.HELLO: _unpack_hello,
    PacketType.STATUS: _unpack_status,
    PacketType.REPLY: _unpack_reply,
    PacketType.SELFTEST: _unpack_selftest,
    PacketType.LOAD: _unpack_load,
    PacketType.EARLY: _unpack_early,
    **dict.fromkeys(Verb, _unpack_request),
}

_PACK: dict[type[Packet], Callable[[Any], bytes]] = {
    Sample: _pack_sample,
    Hello: _pack_hello,
    Status: _pack_status,
    Reply: _pack_reply,
    Selftest: _pack_selftest,
    Load: _pack_load,
    Early: _pack_early,
    Request: _pack_request,
}


def pack(packet: Packet) -> bytes:
    """Header and body of `packet`; struct.error if a value does not fit its field."""
    return _PACK[type(packet)](packet)


def unpack(body: bytes) -> Packet:
    """The packet in header and body (without COBS and CRC); MalformedError if the bytes are no packet of their type."""
    try:
        return _UNPACK[body[0] & 15](body)
    except KeyError:
        raise MalformedError(f"there is no packet type {body[0] & 15}") from None
    except LayoutError as error:
        raise MalformedError(str(error)) from None
