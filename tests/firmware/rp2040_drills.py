"""The RP2040's firmware on rp2040js (an emulator of the whole chip) with the STM32's emulated switches and chips.

`make test-rp2040` installs rp2040js and runs this. rp2040js sends bytes at once and gives the I2C no wires: the line's
speed, and the clocks that free a bus, are not tested here. The USB controller and its host are our own
(`usb_host.cjs`), by the data sheet.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_stm32_build import FIRMWARE, make

from emulator.chips import Hmc5983
from emulator.magnetometers import Lis3mdl, Mmc5983ma, Qmc5883l
from emulator.memsic_film import Memsic
from emulator.mlx90393 import Mlx90393
from emulator.rp2040_board import Rp2040Board
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.sensor.wire.packets import (
    ALL_PADS,
    Hello,
    Load,
    Packet,
    Reply,
    Request,
    Sample,
    Selftest,
    SensorState,
    Status,
    Verb,
)

pytestmark = pytest.mark.needs("arm-none-eabi-gcc", "node")
LIBRARY = Path(os.environ.get("RP2040JS") or FIRMWARE.parent / ".venv/node_modules/rp2040js") / "dist/cjs/index.js"
FIELDS_GAUSS = [(0.1 * (n + 1), -0.05 * (n + 1), 0.3) for n in range(8)]
KINDS: dict[str, tuple[type[Any], int, int]] = {  # gain code and rate
    "hmc5983": (Hmc5983, 3, 220),
    "mmc5983ma": (Mmc5983ma, 0, 220),
    "mlx90393": (Mlx90393, 0, 220),
    "lis3mdl": (Lis3mdl, 3, 155),
    "qmc5883l": (Qmc5883l, 0, 200),
}


class Stream:
    """A board and its output."""

    def __init__(self, kind: str = "hmc5983", channels: Sequence[int] = range(4), board: str = "pico") -> None:
        make("rp2040", f"RP2040_BOARD={board}")
        image = FIRMWARE / f"build/fmfts-rp2040{'' if board == 'pico' else '-' + board}.bin"
        self.decoder, self.packets = Decoder(), list[Packet]()
        self.board = Rp2040Board(LIBRARY, image, lambda n, time_s: self._made(kind, n, time_s), channels)

    @staticmethod
    def _made(kind: str, channel: int, time_s: Callable[[], float]) -> Any:
        error = (channel - 1.5) * 0.01
        chip = KINDS[kind][0](time_s, FIELDS_GAUSS[channel], clock_error=error, phase_s=0.0007 * channel)
        if isinstance(chip, Memsic):
            chip.repeatability_gauss = 0.0  # otherwise each SET leaves 1 mG, four steps
        return chip

    def run(self, seconds: float) -> list[Packet]:
        packets = self.decoder.feed(self.board.run(seconds))
        self.packets += packets
        return packets

    def open_usb(self) -> None:
        """Plugs in the board's own USB, and a program opens the port."""
        self.run(0.02)
        self.board.usb("plug")
        self.run(0.06)
        self.board.usb("open", 1)
        self.run(0.01)
        self.board.over_usb.clear()

    def run_over_usb(self, seconds: float) -> list[Packet]:
        self.board.run(seconds)
        packets = self.decoder.feed(b"".join(self.board.over_usb))
        self.board.over_usb.clear()
        self.packets += packets
        return packets

    def samples(self, seconds: float) -> list[Sample]:
        return [packet for packet in self.run(seconds) if isinstance(packet, Sample)]

    def ask(self, verb: Verb, argument: int = 0) -> int:
        self.board.send(encode(Request(verb, 7, ALL_PADS, argument)))
        replies = [packet for packet in self.run(0.01) if isinstance(packet, Reply)]
        assert [reply.request_id for reply in replies] == [7]
        return replies[0].result

    def latest(self, kind: type[Any]) -> Any:
        return next(packet for packet in reversed(self.packets) if isinstance(packet, kind))


@pytest.fixture
def opened() -> Iterator[Callable[[str], Stream]]:
    streams: list[Stream] = []

    def open_stream(kind: str = "hmc5983", channels: Sequence[int] = range(4), board: str = "pico") -> Stream:
        streams.append(Stream(kind, channels, board))
        return streams[-1]

    yield open_stream
    for stream in streams:
        stream.board.close()


def test_pico_boots_says_hello_and_streams_every_frame(opened: Callable[..., Stream]) -> None:
    stream = opened()
    stream.run(0.4)
    hello = stream.latest(Hello)
    assert (hello.clock, hello.rate_hz, len(hello.pads)) == (1, 220, 1)
    assert [sensor.identification for sensor in hello.pads[0].sensors] == [b"H43"] * 4
    samples = stream.samples(1.0)
    assert abs(len(samples) - 220) <= 1
    assert all(sample.valid == 15 for sample in samples)
    fresh = sum(bin(sample.fresh).count("1") for sample in samples)
    assert fresh >= 0.97 * 4 * 220
    assert abs(stream.board.baud / 460_800 - 1) < 0.001
    assert (stream.decoder.crc_errors, stream.decoder.garbage_bytes, stream.board.mux.conflicts) == (0, 0, 0)
    assert stream.board.now_s == pytest.approx(samples[-1].time_us * 1e-6, abs=0.02)


def test_qt_py_streams_over_usb_and_releases_its_own_lines(opened: Callable[..., Stream]) -> None:
    """The emulator knows the I2C's pins only while a line is held: SDA of port 1 is GPIO 24 there."""
    stream = opened(board="qtpy")
    stream.open_usb()
    stream.run_over_usb(0.4)
    samples = [packet for packet in stream.run_over_usb(1.0) if isinstance(packet, Sample)]
    assert abs(len(samples) - 220) <= 1
    assert all(sample.valid == 15 for sample in samples)
    stream.board.hold(4, False)  # the Pico's SDA
    samples = [packet for packet in stream.run_over_usb(0.2) if isinstance(packet, Sample)]
    assert samples[-1].valid == 15
    stream.board.hold(24, False)
    samples = [packet for packet in stream.run_over_usb(0.2) if isinstance(packet, Sample)]
    assert samples[-1].valid == 0
    stream.board.hold(24, True)
    samples = [packet for packet in stream.run_over_usb(0.5) if isinstance(packet, Sample)]
    assert samples[-1].valid == 15


def test_eight_sensors_become_one_pad_and_stay_one_when_watchdog_bites(opened: Callable[..., Stream]) -> None:
    stream = opened(channels=range(8))
    stream.run(0.4)
    assert [len(pad.sensors) for pad in stream.latest(Hello).pads] == [4, 4]
    assert stream.ask(Verb.HELLO, 8) == 0
    stream.run(0.3)
    assert [len(pad.sensors) for pad in stream.latest(Hello).pads] == [8]
    samples = stream.samples(1.0)
    assert abs(len(samples) - 220) <= 1
    assert all(sample.valid == 0xFF for sample in samples)
    counts = np.mean([sample.counts for sample in samples], axis=0) / 660
    assert counts == pytest.approx(np.array(FIELDS_GAUSS), abs=0.002)
    stream.board.hang()
    stream.packets.clear()
    stream.run(0.6)
    assert [len(pad.sensors) for pad in stream.latest(Hello).pads] == [8]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "hmc5983"])
def test_every_chip_arrives_as_its_field(opened: Callable[..., Stream], kind: str) -> None:
    _, gain_code, rate_hz = KINDS[kind]
    stream = opened(kind)
    stream.run(0.3)
    assert stream.ask(Verb.RANGE, gain_code) == stream.ask(Verb.RATE, rate_hz) == 0
    stream.run(0.3)
    samples = stream.samples(0.5)
    assert abs(len(samples) - rate_hz / 2) <= 1
    assert all(sample.valid == 15 for sample in samples)
    step_t = CHIPS[kind].step_t[gain_code]
    assert samples[-1].counts * step_t == pytest.approx(
        np.array(FIELDS_GAUSS[:4]) * 1e-4, abs=float(np.abs(step_t).max())
    )
    assert stream.ask(Verb.TRIGGER, 1) == 0
    if not CHIPS[kind].board_single_hz:  # it takes no trigger, and is detected again when nobody requests one
        stream.run(0.3)
        assert set(stream.latest(Status).pads[0].states) == {SensorState.CONFIGURATION_LOST}
        assert stream.ask(Verb.TRIGGER, 0) == 0
        stream.run(1.5)
        assert stream.samples(0.1)[-1].valid == 15
        return
    assert stream.ask(Verb.RATE, CHIPS[kind].board_single_hz) == 0
    stream.run(0.3)
    samples = stream.samples(0.5)
    assert len(samples) >= 0.97 * CHIPS[kind].board_single_hz / 2
    assert all(sample.valid == sample.fresh == 15 for sample in samples)


def test_only_unplugged_sensor_is_missed_and_found_again(opened: Callable[..., Stream]) -> None:
    stream = opened()
    stream.run(0.4)
    stream.board.chips[2].absent = True
    stream.run(0.4)
    assert stream.latest(Status).pads[0].states == (0, SensorState.OK, SensorState.NO_ANSWER, 0)
    assert stream.samples(0.1)[-1].valid == 0b1011
    stream.board.chips[2].power_on()
    stream.board.chips[2].absent = False
    stream.run(1.0)
    assert stream.samples(0.1)[-1].valid == 15


def test_line_held_low_is_named_and_released(opened: Callable[..., Stream]) -> None:
    stream = opened()
    stream.run(0.4)
    stream.board.hold(4, level=False)
    stream.run(0.4)
    assert set(stream.latest(Status).pads[0].states) == {SensorState.BUS_STUCK}
    stream.board.hold(4, level=True)
    stream.run(1.0)
    assert stream.samples(0.1)[-1].valid == 15


def test_selftest_measures_every_chip(opened: Callable[..., Stream]) -> None:
    stream = opened()
    stream.run(0.4)
    assert stream.ask(Verb.SELFTEST) == 0
    stream.run(0.4)
    assert [sensor.positive for sensor in stream.latest(Selftest).sensors] == [(452, 452, 421)] * 4


def test_load_cell_is_read(opened: Callable[..., Stream]) -> None:
    stream = opened()
    stream.board.converter.counts = -123456
    stream.run(0.4)
    loads = [packet for packet in stream.run(0.5) if isinstance(packet, Load)]
    assert abs(len(loads) - 40) <= 1
    assert {load.counts for load in loads} == {-123456}
    assert stream.board.complaints == []


def test_program_that_hangs_is_reset_by_the_watchdog(opened: Callable[..., Stream]) -> None:
    stream = opened()
    stream.run(0.4)
    stream.board.hang()
    stream.packets.clear()
    stream.run(0.7)
    assert stream.latest(Hello).reset_cause == 4
    assert stream.samples(0.1)[-1].valid == 15


def test_usb_serial_port_carries_the_flash_number(opened: Callable[..., Stream]) -> None:
    stream = opened()
    stream.run(0.3)
    stream.board.usb("plug")
    stream.run(0.06)
    found = stream.board.found
    assert found["first"] == found["device"]
    vendor, product = (found["device"][at] + 256 * found["device"][at + 1] for at in (8, 10))
    assert (vendor, product) == (0x2E8A, 0x000A)
    assert found["head"] == found["configuration"][:9]
    interfaces, endpoints = descriptors(found["configuration"])
    assert [(each[2], each[4], each[5], each[6]) for each in interfaces] == [(0, 1, 2, 2), (1, 2, 10, 0)]
    assert [(each[2], each[3], each[4]) for each in endpoints] == [(0x81, 3, 8), (0x02, 2, 64), (0x82, 2, 64)]
    texts = [bytes(each[2:]).decode("utf-16-le") for each in found["strings"][1:4]]
    assert texts == ["fmfts", "fmfts board", "E6613852830A5C21"]
    assert stream.latest(Hello).uid == bytes.fromhex(texts[2]) + bytes(4)
    assert (found["configured"], found["state"], found["coding"]) == ([], [1], [0, 8, 7, 0, 0, 0, 8])
    # A board refuses whatever its full-speed USB does not have.
    assert found["qualifier"] is found["unknown"] is found["strings"][4] is None
    assert stream.board.complaints == []


def descriptors(configuration: list[int]) -> tuple[list[list[int]], list[list[int]]]:
    """Of interfaces and of endpoints."""
    assert configuration[2] + 256 * configuration[3] == len(configuration)
    found, at = [], 0
    while at < len(configuration):
        found.append(configuration[at : at + configuration[at]])
        at += configuration[at]
    return [each for each in found if each[1] == 4], [each for each in found if each[1] == 5]


def test_stream_takes_usb_while_a_program_has_the_port_open(opened: Callable[..., Stream]) -> None:
    stream = opened()
    stream.open_usb()
    stream.run_over_usb(0.3)
    samples = [packet for packet in stream.run_over_usb(1.0) if isinstance(packet, Sample)]
    assert abs(len(samples) - 220) <= 1
    assert all(sample.valid == 15 for sample in samples)
    assert not stream.board.sent
    stream.board.usb("send", *encode(Request(Verb.RATE, 7, ALL_PADS, 75)))
    stream.run_over_usb(0.02)
    assert stream.latest(Reply).result == 0
    stream.board.usb("open", 0)
    stream.run(0.1)
    stream.board.over_usb.clear()
    stream.decoder = Decoder()
    assert len(stream.samples(1.0)) in (74, 75, 76)
    assert stream.board.over_usb == []
    assert (stream.decoder.crc_errors, stream.board.complaints) == (0, [])


def test_host_driver_passes_each_line_on_at_once(opened: Callable[..., Stream]) -> None:
    """The driver passes data on after a short packet: an empty one must follow a line of 64 bytes."""
    stream = opened()
    stream.open_usb()
    stream.board.run(0.5)
    lines = list(stream.board.over_usb)
    assert len(lines) > 100
    assert all(line.endswith(b"\0") for line in lines if len(line) < 128)
    for length in range(60, 70):
        name = encode(Request(Verb.RATE, length, ALL_PADS, 220))
        stream.board.usb("send", *(bytes(length) + name))
        stream.run_over_usb(0.02)
        assert stream.latest(Reply).request_id == length
    assert stream.board.complaints == []


def test_host_that_does_not_read_costs_whole_lines_and_nothing_after(opened: Callable[..., Stream]) -> None:
    stream = opened()
    stream.open_usb()
    stream.run_over_usb(0.3)
    stream.board.usb("read", 0)
    assert stream.run_over_usb(0.5) == []
    stream.board.usb("read", 1)
    samples = [packet for packet in stream.run_over_usb(0.5) if isinstance(packet, Sample)]
    late = [sample for sample in samples if sample.time_us * 1e-6 < stream.board.now_s - 0.52]
    assert 5 <= len(late) <= 12  # what the ring holds
    assert len(samples) - len(late) in (109, 110, 111)
    assert (stream.decoder.crc_errors, stream.board.complaints) == (0, [])


@pytest.mark.parametrize("in_handler", [False, True], ids=["program", "handler"])
def test_reset_leaves_the_bus_and_comes_back(opened: Callable[..., Stream], in_handler: bool) -> None:
    stream = opened()
    stream.open_usb()
    stream.run_over_usb(0.2)
    stream.board.hang(in_handler)
    stream.board.run(0.3)  # the watchdog
    stream.board.over_usb.clear()
    stream.packets.clear()
    stream.open_usb()
    packets = stream.run_over_usb(0.6)
    assert len([packet for packet in packets if isinstance(packet, Sample)]) > 100
    assert stream.board.complaints == []


def test_cable_that_was_pulled_may_be_plugged_in_again(opened: Callable[..., Stream]) -> None:
    """The board has another supply, so it continues meanwhile: over its UART, because nobody has its port open."""
    stream = opened()
    stream.open_usb()
    stream.board.usb("send", *encode(Request(Verb.RATE, 1, ALL_PADS, 220)))
    stream.run_over_usb(0.3)
    stream.board.usb("unplug")
    stream.decoder = Decoder()
    assert len(stream.samples(0.2)) in (43, 44, 45)
    stream.decoder = Decoder()
    stream.open_usb()
    stream.board.usb("send", *encode(Request(Verb.RATE, 2, ALL_PADS, 220)))
    packets = stream.run_over_usb(0.5)
    assert len([packet for packet in packets if isinstance(packet, Sample)]) > 100
    assert stream.latest(Reply).request_id == 2
    assert stream.board.complaints == []
