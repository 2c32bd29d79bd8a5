"""Reads the force: lines of a serial or UDP gauge, or the load cell on the pad's own board."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from fmfts.cli.feed import Counts
from fmfts.sensor.bridge import serial_port
from fmfts_collect.datagrams import Datagrams
from fmfts_collect.errors import AbsentError
from fmfts_collect.settings import GaugeConfig, LoadCellGauge, SerialGauge, UdpGauge

ASK_NS = 20_000_000  # interval at which a gauge that does not stream is asked again, if it has not answered
LONGEST_LINE = 256


@dataclass(frozen=True, slots=True)
class Reading:
    """A force. time_ns: when it acted, on CLOCK_MONOTONIC."""

    time_ns: int
    force_n: float


class Gauge(Protocol):
    """A force gauge; no call blocks."""

    description: str

    @property
    def unread(self) -> str:
        """The last input that was no reading, and why, as a clause; "" if all were readings."""

    def poll(self, now_ns: int) -> Sequence[Reading]:
        """The readings since the last call. Raises AbsentError where the gauge has gone."""

    def close(self) -> None:
        """Close the device."""


def open_gauge(config: GaugeConfig, counts: Counts | None) -> Gauge:
    """The gauge of the configuration. counts: reads the board's load cell; None where this process cannot.

    Raises AbsentError where the gauge cannot be opened.
    """
    match config:
        case SerialGauge():
            return LineGauge(config, _SerialLine(config))
        case UdpGauge():
            return LineGauge(config, Datagrams(config))
        case LoadCellGauge():
            if counts is None:
                raise AbsentError(
                    'gauge type = "hx711": the load cell is on the pad\'s board, and only the program that has opened '
                    "the board can read it: stop fmfts-daemon, and see that the pad's source is a bridge"
                )
            return LoadCell(config, counts)


class LineGauge:
    """A gauge that sends lines of text; the pattern finds the number. Lines without a finite number are left out."""

    def __init__(self, config: SerialGauge | UdpGauge, lines: _SerialLine | Datagrams) -> None:
        self.description = lines.description
        self._without_number = ""
        self._lines = lines
        self._pattern = re.compile(config.pattern)
        self._newton_per_unit = config.newton_per_unit
        self._delay_ns = round(config.delay_ms * 1e6)

    def poll(self, now_ns: int) -> list[Reading]:
        readings = []
        for line in self._lines.take(now_ns):
            match = self._pattern.search(line)
            try:
                force_n = float(match[1]) * self._newton_per_unit if match else math.nan
            except (TypeError, ValueError):
                force_n = math.nan
            # NaN must not get through: it would pass every comparison with a force limit.
            if math.isfinite(force_n):
                readings.append(Reading(now_ns - self._delay_ns, force_n))
            else:
                self._without_number = line[:40]
        return readings

    @property
    def unread(self) -> str:
        if self._lines.refused:
            return self._lines.refused
        return f"the last line without a number was {self._without_number!r}" if self._without_number else ""

    def close(self) -> None:
        self._lines.close()


class LoadCell:
    """An HX711 behind the STM32 bridge: 24-bit counts in the stream of the frames."""

    description = "the load cell on the pad's board"
    unread = ""

    def __init__(self, config: LoadCellGauge, counts: Counts) -> None:
        self._counts = counts
        self._newton_per_count = config.newton_per_count
        self._delay_ns = round(config.delay_ms * 1e6)

    def poll(self, now_ns: int) -> list[Reading]:
        return [
            Reading(time_ns - self._delay_ns, counts * self._newton_per_count) for time_ns, counts in self._counts()
        ]

    def close(self) -> None:
        """Nothing to close: the feed closes the board."""


class _SerialLine:
    refused = ""

    def __init__(self, config: SerialGauge) -> None:
        self.description = f"the gauge on {config.port}"
        self._ask = config.ask.encode()
        self._asked_ns = 0
        self._rest = b""
        try:
            self._port = serial_port.open_raw(config.port, config.baud)
        except OSError as error:
            why = serial_port.why_not_open(config.port, error).replace("board", "gauge")
            raise AbsentError(f"gauge: {config.port} {why}") from error

    def take(self, now_ns: int) -> list[str]:
        try:
            data = os.read(self._port.fileno(), 4096)
        except BlockingIOError:
            data = None
        except OSError as error:
            raise AbsentError(f"{self.description} is gone ({error.strerror}): plug it in again") from error
        if data == b"":
            raise AbsentError(f"{self.description} hung up: plug it in again")
        *lines, self._rest = re.split(rb"[\r\n]+", self._rest[-LONGEST_LINE:] + (data or b""))
        if self._ask and (lines or now_ns - self._asked_ns > ASK_NS):
            self._asked_ns = now_ns
            with suppress(BlockingIOError):  # then the next call asks again
                os.write(self._port.fileno(), self._ask)
        return [line.decode("ascii", "replace") for line in lines if line]

    def close(self) -> None:
        serial_port.close(self._port)
