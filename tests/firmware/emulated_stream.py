"""The firmware's ELF on the emulated chip; the daemon's own decoder reads its stream."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TypeVar

from emulator.stm32_board import Board
from emulator.stm32_core import SYSTICK
from fmfts.sensor.wire.framing import Decoder, encode
from fmfts.sensor.wire.packets import ALL_PADS, Hello, Packet, Reply, Request, Sample, Status, Verb

FIRMWARE = Path(__file__).parents[2] / "firmware"
EVERYONE = 0b1111
T = TypeVar("T", bound=Packet)


@cache
def firmware() -> Path:
    built = subprocess.run(["make", "-C", FIRMWARE, "stm32"], capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return FIRMWARE / "build" / "fmfts.elf"


class EmulatedStream:
    """A board, its output so far, and its latest status and hello."""

    def __init__(self, **options: object) -> None:
        self.board = Board(firmware(), **options)
        self.decoder = Decoder()
        self.raw = bytearray()
        self.packets: list[Packet] = []
        self._request_id = 0

    def run(self, seconds: float) -> list[Packet]:
        """The packets of these seconds of the board's time."""
        data = self.board.run(seconds)
        self.raw += data
        packets = self.decoder.feed(data)
        self.packets += packets
        return packets

    def samples(self, seconds: float, pad: int = 0) -> list[Sample]:
        return [packet for packet in self.run(seconds) if isinstance(packet, Sample) and packet.pad_index == pad]

    def latest(self, kind: type[T]) -> T:
        return next(packet for packet in reversed(self.packets) if isinstance(packet, kind))

    @property
    def status(self) -> Status:
        return self.latest(Status)

    @property
    def hello(self) -> Hello:
        return self.latest(Hello)

    def request(self, verb: Verb, argument: int = 0, pad: int = ALL_PADS) -> Reply:
        self._request_id += 1
        self.board.send(encode(Request(verb, self._request_id, pad, argument)))
        self.wait(lambda packet: isinstance(packet, Reply) and packet.request_id == self._request_id, 0.05)
        return self.latest(Reply)

    def wait(self, wanted: Callable[[Packet], bool], limit_s: float, step_s: float = 0.01) -> float:
        """Seconds of the board's time until a packet came for which `wanted` holds, to within a step."""
        begun_s = self.board.now_s
        while not any(map(wanted, self.run(step_s))):
            assert self.board.now_s - begun_s <= limit_s, (
                f"not within {limit_s} s; {self.status}, {self.board.complaints}"
            )
        return self.board.now_s - begun_s

    def wait_until_whole(self, limit_s: float = 1.0) -> float:
        """Until every sensor's samples are valid."""
        return self.wait(lambda packet: isinstance(packet, Sample) and packet.valid == EVERYONE, limit_s)

    def wait_for_status(self, wanted: Callable[[Status], bool], limit_s: float = 1.1) -> Status:
        """Statuses come once a second, and when a sensor's state changes."""
        self.wait(lambda packet: isinstance(packet, Status) and wanted(packet), limit_s)
        return next(packet for packet in reversed(self.packets) if isinstance(packet, Status) and wanted(packet))

    def clock_us(self) -> float:
        """The firmware's present microsecond counter: whole SysTick periods, and the part of this one."""
        machine = self.board.machine
        systick = machine.core.systick
        counts = machine.core.entered[SYSTICK] * (systick.load + 1) + systick.load - systick.value()
        return counts / self.board.rcc.hz * 1e6

    def is_clean(self) -> bool:
        """No byte on the line was wasted, and the chip has no complaint."""
        errors = self.decoder.crc_errors + self.decoder.garbage_packets + self.decoder.garbage_bytes
        return errors == 0 and self.board.complaints == []
