"""A Pico with this firmware on rp2040js; its I2C pins have the same emulated switches and chips as the STM32."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from emulator.chips import Bus, Tca9548a
from emulator.hx711 import Hx711

PROGRAM = Path(__file__).with_name("rp2040_chip.cjs")


class Rp2040Board:
    """library: rp2040js. image: the flash. make(number, time_s): a chip. channels: of the switch on port 1, for each
    chip; None: they sit on port 1 without a switch.
    """

    def __init__(
        self,
        library: Path,
        image: Path,
        make: Callable[[int, Callable[[], float]], Any],
        channels: Sequence[int] | None = range(4),
    ) -> None:
        self.now_s = 0.0
        self.baud = 0
        self.warnings = ""
        self.sent = bytearray()
        self.over_usb: list[bytes] = []
        self.found: dict[str, Any] = {}
        self.chips = [make(number, lambda: self.now_s) for number in range(4 if channels is None else len(channels))]
        self.mux = Tca9548a(0x70, dict(zip(channels or (), self.chips, strict=False)))
        self.buses = [Bus([], self.chips) if channels is None else Bus([self.mux]), Bus([])]
        self.complaints: list[str] = []
        self.converter = Hx711(lambda: self.now_s, self.complaints.append)
        self._process = subprocess.Popen(
            ["node", PROGRAM, library, image], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._until_ready()

    def close(self) -> None:
        self._process.kill()
        with self._process:  # closes its pipes, and waits
            pass

    def run(self, seconds: float) -> bytes:
        """Let the board run; returns the bytes that the host received meanwhile."""
        self._order(f"run {self.now_s + seconds:.9f}")
        received = bytes(self.sent)
        self.sent.clear()
        return received

    def send(self, data: bytes) -> None:
        self._order("feed " + " ".join(map(str, data)))

    def usb(self, order: str, *numbers: int) -> None:
        """`plug`, `unplug`, `open 1` or `0`, `read 1` or `0`, `send BYTE …`: actions of the host on its USB."""
        self._order(" ".join(["usb", order, *map(str, numbers)]))

    def hold(self, pin: int, level: bool) -> None:
        self._order(f"line {pin} {int(level)}")

    def hang(self, in_handler: bool = False) -> None:
        """The main program enters an endless loop while interrupts continue; or an interrupt's handler does."""
        self._order(f"hang {'handler' if in_handler else 'program'}")

    def _order(self, line: str) -> None:
        self._answer(line)
        self._until_ready()

    def _answer(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def _until_ready(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            verb, *words = line.split(maxsplit=2) if line.startswith("ready") else line.split()
            if verb == "sent":
                self.sent.append(int(words[0]))
            elif verb == "baud":
                self.baud = int(words[0])
            elif verb == "over-usb":
                self.over_usb.append(bytes(map(int, words)))
            elif verb == "found":
                self.found = json.loads("".join(words))
            elif verb == "complaint":
                self.complaints.append(" ".join(words))
            elif verb == "ready":
                self.now_s = float(words[0])
                self.warnings = words[1].strip() if len(words) > 1 else ""
                return
            else:
                self.now_s = float(words[0])
                answer = self._on_pins(verb, *map(int, words[1:]))
                if answer is not None:
                    self._answer(str(answer))
        raise AssertionError(f"node ended with {self._process.wait()}")

    def _on_pins(self, verb: str, number: int = 0, value: int = 0, reading: int = 0) -> int | None:
        """None: the emulator expects no answer."""
        if verb == "clock":
            self.converter.clock_driven(bool(number))
        if verb in ("clock", "data"):
            return int(self.converter.data_level())
        bus = self.buses[number]
        if verb == "start":
            return int(bus.start(value, bool(reading)))
        if verb == "get":
            return bus.get()
        if verb == "put":
            bus.put(value)
        else:
            bus.stop()
        return None
