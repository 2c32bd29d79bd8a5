"""The two streams of ReSkin, AnySkin and eFlesh boards, as raunaqbhirangi/anyskin publishes them, and nothing else.

Binary: for each magnetometer four little-endian floats, temperature (°C) and x, y, z (µT), and after the last CR LF.
There is no check sum, and CR LF may also stand inside of a float; so a packet counts only if its end and its
temperatures are right, and after damage only if the next one is right, too.
Text: a line of the same numbers with two decimals each. The published sketch puts nothing between one magnetometer
and the next ("3.0024.98"), so a number is what ends two digits after its point.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from struct import Struct
from typing import NamedTuple

END = b"\r\n"
WARMEST_C, COLDEST_C = 125.0, -40.0  # the chip's limits: values beyond them were read while it had no sample
LARGEST_UT = 5e5  # ten times the chip's largest reading; 0xFFFF of a silent chip becomes 4.8e5 at the coarsest setting
_NUMBER = re.compile(rb"-?\d+\.\d\d|-?(?:nan|inf|ovf)")
_LONGEST_LINE = 1024


class Reading(NamedTuple):
    """One magnetometer. is_measured: its temperature is possible, which it is not where the chip had no sample."""

    temperature_c: float
    field_ut: tuple[float, float, float]
    is_measured: bool


Packet = tuple[Reading, ...]


class BinaryStream:
    """Cuts packets of `magnetometers` out of bytes. garbage_bytes: those that belonged to none."""

    def __init__(self, magnetometers: int) -> None:
        self._layout = Struct(f"<{4 * magnetometers}f")
        self._size = self._layout.size + len(END)
        self._buffer = b""
        self._joined = False
        self.garbage_bytes = 0

    def feed(self, data: bytes) -> Iterator[Packet]:
        self._buffer += data
        start = 0
        while len(self._buffer) - start >= self._size * (1 if self._joined else 2):
            packet = self._at(start)
            if packet is not None and (self._joined or self._at(start + self._size) is not None):
                self._joined = True
                start += self._size
                yield packet
            else:
                # Not the whole packet: if bytes were lost, its first ones may belong to another packet.
                self._joined = False
                start += 1
                self.garbage_bytes += 1
        self._buffer = self._buffer[start:]

    def _at(self, start: int) -> Packet | None:
        stop = start + self._layout.size
        if self._buffer[stop : stop + len(END)] != END:
            return None
        return packet_of(self._layout.unpack_from(self._buffer, start))


class TextStream:
    """The same for lines of text."""

    def __init__(self, magnetometers: int) -> None:
        self._numbers = 4 * magnetometers
        self._buffer = b""
        self._joined = False  # the first line may have lost its beginning
        self.garbage_bytes = 0

    def feed(self, data: bytes) -> Iterator[Packet]:
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        for line in lines:
            packet = self._of(line)
            if packet is not None and self._joined:
                yield packet
            elif line.strip():
                self.garbage_bytes += len(line) + 1
            self._joined = True
        if len(self._buffer) > _LONGEST_LINE:
            self.garbage_bytes += len(self._buffer)
            self._buffer = b""

    def _of(self, line: bytes) -> Packet | None:
        numbers = _NUMBER.findall(line)
        between = _NUMBER.sub(b"", line).strip(b"\t\r ")
        if len(numbers) != self._numbers or between.strip(b"\t ,") != b"":
            return None
        return packet_of([float(number.replace(b"ovf", b"nan")) for number in numbers])


def packet_of(numbers: Sequence[float]) -> Packet | None:
    """None if these cannot be readings: none of the temperatures is possible, or no magnet makes such a field."""
    readings = []
    for start in range(0, len(numbers), 4):
        temperature_c, x, y, z = numbers[start : start + 4]
        if any(abs(value) > LARGEST_UT for value in (x, y, z) if math.isfinite(value)):
            return None
        readings.append(Reading(temperature_c, (x, y, z), COLDEST_C <= temperature_c <= WARMEST_C))
    return tuple(readings) if any(reading.is_measured for reading in readings) else None
