"""A running fmfts-host and a decoder of its stream that shares no code with the daemon."""

from __future__ import annotations

import os
import select
import struct
import subprocess
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

ROOT = Path(__file__).parents[2]
SAMPLE, HELLO, STATUS, REPLY, SELFTEST = 1, 2, 3, 4, 5
ATTEMPTS = 10
T = TypeVar("T")


def crc(data: bytes) -> int:
    register = 0xFFFF
    for byte in data:
        for bit in range(8):
            high = register >> 15 ^ byte >> (7 - bit) & 1
            register = register << 1 & 0xFFFF ^ (0x1021 if high else 0)
    return register


def unstuff(line: bytes) -> bytes | None:
    out, rest = bytearray(), line
    while rest:
        code, rest = rest[0], rest[1:]
        if code - 1 > len(rest):
            return None
        out += rest[: code - 1]
        rest = rest[code - 1 :]
        if code < 255 and rest:
            out.append(0)
    return bytes(out)


def stuff(packet: bytes) -> bytes:
    return b"".join(bytes([len(run) + 1]) + run for run in packet.split(b"\0")) + b"\0"


@dataclass(frozen=True)
class Sample:
    pad: int
    sequence: int
    time_us: int
    gain_code: int
    valid: int
    fresh: int
    temperature_raw: int
    counts: list[tuple[int, int, int]]

    @classmethod
    def parse(cls, packet: bytes) -> Sample:
        pad, sequence, low, high, flags, valid, fresh, temperature = struct.unpack_from("<xBIIHBBBh", packet)
        sensors = [struct.unpack_from("<hhh", packet, 17 + 8 * i) for i in range(pad >> 4)]
        return cls(pad & 15, sequence, low + (high << 32), flags & 7, valid, fresh, temperature, sensors)


class HostBoard:
    """Starts the process, opens its pty, and takes its stream apart. `bad` counts lines that are no packet."""

    def __init__(self, *arguments: str) -> None:
        self.bad = 0
        self._rest = b""
        self._whole: deque[bytes] = deque()
        self.process = subprocess.Popen(
            [ROOT / "firmware/build/fmfts-host", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        assert self.process.stdout is not None
        first = self.process.stdout.readline()
        assert first.startswith("pty: /dev/"), first
        self.path = first.split()[1]
        self.port = os.open(self.path, os.O_RDWR | os.O_NOCTTY)

    def __enter__(self) -> HostBoard:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self.port)
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            pipe.close()

    def command(self, line: str) -> str:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(line + "\n")
        return self.process.stdout.readline().strip()

    def request(self, verb: int, request_id: int, pad: int = 255, argument: int = 0) -> None:
        packet = struct.pack("<BBBH", 0x10 | verb, request_id, pad, argument)
        os.write(self.port, stuff(packet + struct.pack("<H", crc(packet))))

    def packets(self, seconds: float) -> Iterator[bytes]:
        """Whole packets without their CRC, as they come within this time."""
        end, is_over = time.monotonic() + seconds, False
        while True:
            while self._whole:
                yield self._whole.popleft()
            left = end - time.monotonic()
            if is_over or not select.select([self.port], [], [], max(left, 0.0))[0]:
                return
            is_over = left <= 0  # what came in time is read, even if a busy computer stopped this process meanwhile
            *lines, self._rest = (self._rest + os.read(self.port, 65536)).split(b"\0")
            for line in filter(None, lines):
                packet = unstuff(line)
                if packet is None or len(packet) < 3 or crc(packet[:-2]) != int.from_bytes(packet[-2:], "little"):
                    self.bad += 1
                else:
                    self._whole.append(packet[:-2])

    def samples(self, seconds: float) -> Iterator[Sample]:
        return (Sample.parse(packet) for packet in self.packets(seconds) if packet[0] & 15 == SAMPLE)

    def quiet(self) -> list[Sample]:
        """All samples until nothing comes for a while, as from a board that is stepped or held."""
        samples: list[Sample] = []
        while more := list(self.samples(0.3)):
            samples += more
        return samples

    def dropped(self) -> int:
        """The packets that found no room on the line, because this process stood still."""
        self.request(15, 1)
        return int.from_bytes(self.wait_for(STATUS)[7:11], "little")

    def undisturbed(self, look: Callable[[], T]) -> T:
        """What `look` returns, once no packet was dropped meanwhile."""
        for _ in range(ATTEMPTS):
            before = self.dropped()
            found = look()
            if self.dropped() == before:
                return found
        raise AssertionError(f"packets were dropped {ATTEMPTS} times: this computer is too busy")

    def wait_for(self, kind: int, seconds: float = 60.0) -> bytes:
        """The next packet of a type; waits long, because it only has to come."""
        for packet in self.packets(seconds):
            if packet[0] & 15 == kind:
                return packet
        raise AssertionError(f"no packet of type {kind} within {seconds} s")

    def wait_for_sample(self, wanted: Callable[[Sample], bool], seconds: float = 60.0) -> Sample:
        """The next sample for which `wanted` holds."""
        for sample in self.samples(seconds):
            if wanted(sample):
                return sample
        raise AssertionError(f"no such sample within {seconds} s")
