"""The packets of firmware/wire.md as values, from boards and from hosts; codec.py turns them into bytes."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

MAX_SENSORS = 16  # of a pad
BOARD_SENSORS = 8  # sensors of a pad in a board's packets; only a bus of this computer reads more
FOUND_SENSORS = 4  # sensors of a pad that a board finds: half the channels of a TCA9548A
ALL_BOARD_SENSORS = 12  # sensors of all pads of a board together
COUNT_BITS = 4  # bits of a hello request's argument for the sensors of each pad
MOST_DESCRIBED = 44  # sensors of all pads together: a hello of three pads holds no more
MORE_SENSORS = 9  # in place of their number in four bits: more than a board's, and the packet's length says how many
MUX_BASE, MUX_MASK = 0x70, 0x07  # addresses of muxes: they differ in the last three bits
CHANNEL_BITS, CHANNEL_MASK = 3, 0x07  # bits of a channel; above them, its mux's offset from the pad's
MAX_PADS = 3
ALL_PADS = 255
NO_MUX = 0  # in place of a mux's address: then a sensor's channel is its own address
TEMPERATURE_UNKNOWN = -32768
UID_BYTES = 12
LINE_BITS_PER_BYTE = 10  # on a serial line: start, eight data bits, stop
EARLY_BYTES = 19  # bytes of an early packet on the line
FRAME_BYTES = (21, 8)  # bytes of a sample packet of up to eight sensors: fixed, and for each sensor


def frame_bytes(sensors: int) -> int:
    """The bytes of a sample packet on the line."""
    return FRAME_BYTES[0] + FRAME_BYTES[1] * sensors


class PacketType(IntEnum):
    SAMPLE = 1
    HELLO = 2
    STATUS = 3
    REPLY = 4
    SELFTEST = 5
    LOAD = 6
    EARLY = 7


class Verb(IntEnum):
    HELLO = 8
    RANGE = 9
    RATE = 10
    TRIGGER = 11
    START = 12
    STOP = 13
    SELFTEST = 14
    STATUS = 15


class Result(IntEnum):
    DONE = 0
    UNKNOWN_REQUEST = 1
    OUT_OF_RANGE = 2
    NO_SUCH_PAD = 3
    BUSY = 4


class SensorState(IntEnum):
    OK = 0
    NO_ANSWER = 1
    WRONG_IDENTIFICATION = 2
    CONFIGURATION_LOST = 3
    NO_NEW_DATA = 4
    SELFTEST_FAILED = 5
    BUS_STUCK = 6
    MUX_SILENT = 7
    NOT_STARTED = 8


class Sample(Struct, frozen=True, eq=False, gc=False):
    """counts (N, 3) int16 in the order x, y, z; age_us (N,) uint16; valid and fresh are masks, bit i = sensor i.

    N is at most MAX_SENSORS.
    """

    pad_index: int
    sequence: int
    time_us: int
    gain_code: int
    trigger: int
    valid: int
    fresh: int
    temperature_raw: int
    counts: NDArray[np.int16]
    age_us: NDArray[np.uint16]


class HelloSensor(Struct, frozen=True):
    channel: int
    state: int
    identification: bytes


class HelloPad(Struct, frozen=True):
    i2c_port: int
    mux_address: int
    sensors: tuple[HelloSensor, ...]

    def way_to(self, sensor: int) -> tuple[int | None, int]:
        """Mux and channel of a sensor (from 0); without a mux None, and the sensor's own address."""
        channel = self.sensors[sensor].channel
        if self.mux_address == NO_MUX:
            return None, channel
        return MUX_BASE | (self.mux_address + (channel >> CHANNEL_BITS)) & MUX_MASK, channel & CHANNEL_MASK

    @property
    def muxes(self) -> list[int]:
        """Addresses of the muxes that its sensors are behind, each once."""
        found = (self.way_to(sensor)[0] for sensor in range(len(self.sensors)))
        return sorted({mux for mux in found if mux is not None})


def channel_byte(pad_mux: int, mux: int, channel: int) -> int:
    """`HelloSensor.channel` of a sensor behind `mux`, in a pad that names `pad_mux`: see `HelloPad.way_to`."""
    return (mux - pad_mux & MUX_MASK) << CHANNEL_BITS | channel


class Hello(Struct, frozen=True):
    firmware_version: tuple[int, int, int]
    reset_cause: int
    clock: int
    uid: bytes
    rate_hz: int
    gain_code: int
    trigger: int
    running: int
    pads: tuple[HelloPad, ...]
    can_send_early: int = 0
    can_make_pads: int = 0


class StatusPad(Struct, frozen=True):
    bus_errors: int
    bus_recoveries: int
    config_repairs: int
    states: tuple[int, ...]


class Status(Struct, frozen=True):
    time_us: int
    transmit_dropped: int
    receive_errors: int
    pads: tuple[StatusPad, ...]


class Reply(Struct, frozen=True):
    request_id: int
    request_type: int
    result: int


class SelftestSensor(Struct, frozen=True):
    state: int
    positive: tuple[int, int, int]
    negative: tuple[int, int, int]


class Selftest(Struct, frozen=True):
    request_id: int
    pad_index: int
    gain_code: int
    sensors: tuple[SelftestSensor, ...]


class Load(Struct, frozen=True):
    """One conversion of the load cell's HX711: 24 bits, signed."""

    sequence: int
    time_us: int
    counts: int


class Early(Struct, frozen=True):
    """One sensor's sample, sent before the frame that holds it."""

    pad_index: int
    sensor: int
    gain_code: int
    time_us: int
    counts: tuple[int, int, int]


class Request(Struct, frozen=True):
    verb: int
    request_id: int
    pad_index: int
    argument: int


Packet = Sample | Hello | Status | Reply | Selftest | Load | Early | Request
