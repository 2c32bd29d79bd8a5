"""HMC5983 chips behind a TCA9548A, register by register, for any carrier of I2C transfers.

Pure Python without dependencies, so that an emulated kernel bus and an emulated microcontroller can share it. Time
is a callable (seconds), so that a test may own it. Behaviour: Honeywell 900425 (registers, LOCK, RDY, self-test,
gain of the sample after a change) and TI SCPS207 (a channel becomes active after the STOP).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

try:
    from emulator.magnetometer import Magnetometer
except ImportError:  # run by a Python that has this folder on its path, and not the one above
    from magnetometer import Magnetometer  # type: ignore[no-redef]

LSB_PER_GAUSS = (1370, 1090, 820, 660, 440, 390, 330, 230)
OUTPUT_RATE_HZ = (0.75, 1.5, 3, 7.5, 15, 30, 75, 220)
STRAP_GAUSS = (1.16, 1.16, 1.08)
SINGLE_CONVERSION_S = 6e-3
REGISTERS_AFTER_RESET = {0x00: 0x10, 0x01: 0x20, 0x02: 0x01, 0x0A: 0x48, 0x0B: 0x34, 0x0C: 0x33}
WRITABLE = (0x00, 0x01, 0x02)
DATA = range(0x03, 0x09)


class NackError(Exception):
    """No chip pulled SDA low."""


class Hmc5983(Magnetometer):
    """One chip at 0x1E. `strap` multiplies the data sheet's nominal field."""

    address = 0x1E

    strap = 1.0
    subtracts_field = True  # data sheet, self-test operation; it can be read in two ways, hence another kind
    identification = b"H43"

    def power_on(self) -> None:
        self.registers = bytearray(0x40)
        for register, value in REGISTERS_AFTER_RESET.items():
            self.registers[register] = value
        self.pointer = 0
        self._pointer_next = False
        self._alike = 0  # conversions since the configuration was written
        self.locked = False
        self.unread = set(DATA)
        self.ready = False
        self.gain_in_force = 1
        self.next_conversion_s: float | None = None
        self.conversions = 0

    def started(self, reading: bool) -> None:
        """The chip was addressed; the first byte written from now on is the register's number."""
        self.run()
        self._pointer_next = not reading

    def put(self, byte: int) -> None:
        self.run()
        if self._pointer_next:
            self.pointer, self._pointer_next = byte, False
            return
        if self.pointer in WRITABLE:
            self.registers[self.pointer] = byte
            self._configured(self.pointer)
        self._advance_pointer()

    def get(self) -> int:
        self.run()
        value = self._value(self.pointer)
        self._was_read(self.pointer)
        self._advance_pointer()
        return value

    def _value(self, register: int) -> int:
        if register == 0x09:
            return self.ready | self.locked << 1
        if 0x0A <= register <= 0x0C:
            return self.identification[register - 0x0A]
        if register in (0x31, 0x32):
            return round((self.temperature_c - 25.0) * 128).to_bytes(2, "big", signed=True)[register - 0x31]
        return self.registers[register] if register < len(self.registers) else 0

    def _was_read(self, register: int) -> None:
        if register == 0x02:
            self.locked, self.unread = True, set(DATA)
        if register in DATA:
            self.ready = False
            self.unread.discard(register)
            self.locked = bool(self.unread)
            self.unread = self.unread or set(DATA)

    def _advance_pointer(self) -> None:
        self.pointer = {0x08: 0x03, 0x0C: 0x00}.get(self.pointer, self.pointer + 1)

    def _configured(self, register: int) -> None:
        """A new mode or configuration unlocks the output and restarts the measurement."""
        self.locked, self.unread, self.ready = False, set(DATA), False
        self._alike = 0
        now_s = self.time_s()
        mode = self.registers[0x02] & 3
        if mode == 1:
            if register == 0x02:
                self.next_conversion_s = now_s + SINGLE_CONVERSION_S * (1.0 + self.clock_error)
        elif mode == 0:
            # "The first measurement set is available after 2/f"; every chip has a phase of its own.
            self.next_conversion_s = now_s + 2 * self._period_s() + self.phase_s
        else:
            self.next_conversion_s = None

    def _period_s(self) -> float:
        return (1.0 + self.clock_error) / OUTPUT_RATE_HZ[self.registers[0] >> 2 & 7]

    def run(self) -> None:
        """Catch up with the clock: finish all conversions that were due."""
        while self.next_conversion_s is not None and self.next_conversion_s <= self.time_s() and not self.frozen:
            if self.registers[0x02] & 2:  # idle; nothing was written either, or the chip would have measured
                self.next_conversion_s = None
                return
            ended_s = self.next_conversion_s
            if self.registers[0x02] & 3 == 1:
                self.registers[0x02] = 0x03  # back to idle
                self.next_conversion_s = None
            else:
                # The first may have an old gain; all after the second are alike, so a long sleep is not made up for.
                missed = int((self.time_s() - ended_s) / self._period_s()) if self._alike > 1 else 0
                ended_s += missed * self._period_s()
                self.conversions += missed
                self.next_conversion_s = ended_s + self._period_s()
            self.conversions += 1
            self._alike += 1
            self.converted_s = ended_s
            self.converted(ended_s)

    def converted(self, ended_s: float) -> None:
        """A conversion ended; unless LOCK protects the old values, its result is in the output registers."""
        if not self.locked:
            self._convert()

    def _convert(self) -> None:
        bias = {1: self.strap, 2: -self.strap}.get(self.registers[0] & 3, 0.0)
        lsb = LSB_PER_GAUSS[self.gain_in_force]
        counts = []
        field_gauss = self.field_during(self.converted_s, self.converted_s)
        for field, gain, strap in zip(field_gauss, self.gain, STRAP_GAUSS, strict=True):
            noise = self.random.gauss(0.0, self.noise_gauss) if self.noise_gauss else 0.0
            total = round((field + noise + bias * strap) * gain * lsb)
            # Under a bias the chip itself subtracts the field without it.
            shown = round(bias * strap * gain * lsb) if bias and self.subtracts_field else total
            counts.append(shown if -2048 <= total <= 2047 else -4096)
        x, y, z = counts
        for offset, value in zip((0, 2, 4), (x, z, y), strict=True):
            self.registers[3 + offset : 5 + offset] = value.to_bytes(2, "big", signed=True)
        self.ready = True
        self.gain_in_force = self.registers[0x01] >> 5


class Tca9548a:
    """The switch and the chips on its channels."""

    def __init__(self, address: int, channels: dict[int, Any]) -> None:
        """channels: the chip on each, or a list of several with different addresses."""
        self.address = address
        self.channels = channels
        self.control = 0
        self.pending = 0
        self.absent = False
        self.held_in_reset = False
        self.conflicts = 0  # reads that several chips answered at once

    def stop(self) -> None:
        self.control = self.pending

    def reached(self, address: int) -> list[Any]:
        """The chips of this address on the channels that are open."""
        found = []
        for channel, chips in self.channels.items() if self.control else ():
            if self.control >> channel & 1:
                for chip in chips if isinstance(chips, list) else (chips,):
                    if chip.address == address and not chip.absent:
                        found.append(chip)
        return found


class Bus:
    """Muxes, and chips without one, on one pair of wires, byte by byte; `start` and `put` return whether any chip
    acknowledged.

    bit_times: of all transfers, in periods of SCL (NXP UM10204). A START, a repeated START and a STOP take one each, an
    address and each byte nine, with the acknowledgement. Between two transfers the wires are free for tBUF, half a
    period (1.3 µs at 400 kHz), which does not count here.
    """

    def __init__(self, muxes: Sequence[Tca9548a], chips: Sequence[Any] = ()) -> None:
        self.muxes = muxes
        self.chips = chips
        self.transfers = 0
        self.bit_times = 0
        self.conflicts = 0
        self._mux: Tca9548a | None = None
        self._chips: list[Any] = []

    def start(self, address: int, reading: bool) -> bool:
        """(Repeated) START and address."""
        self._mux, self._chips = None, []
        for mux in self.muxes:
            if not (mux.absent or mux.held_in_reset):
                if mux.address == address and self._mux is None:
                    self._mux = mux
                self._chips += mux.reached(address)
        for chip in self.chips:
            if chip.address == address and not chip.absent:
                self._chips.append(chip)
        if len(self._chips) > 1 and reading:
            self.conflicts += 1
            if self.muxes:
                self.muxes[0].conflicts += 1
        for chip in self._chips:
            chip.started(reading)
        return bool(self._mux or self._chips)

    def put(self, byte: int) -> bool:
        if self._mux:
            self._mux.pending = byte
        for chip in self._chips:
            chip.put(byte)
        return bool(self._mux or self._chips)

    def get(self) -> int:
        answer = self._mux.pending if self._mux else 0xFF
        for chip in self._chips:
            answer &= chip.get()  # open drain: any chip's zero wins
        return answer

    def stop(self) -> None:
        self._mux, self._chips = None, []
        for mux in self.muxes:
            mux.stop()

    def transfer(self, messages: Sequence[tuple[int, bytes | int]]) -> list[bytes]:
        """From START to STOP, repeated starts in between; NackError ends it, with its STOP.

        A message is (address, bytes to write or number of bytes to read).
        """
        self.transfers += 1
        self.bit_times += 1  # STOP
        try:
            return [self._message(address, what) for address, what in messages]
        finally:
            self.stop()

    def _message(self, address: int, what: bytes | int) -> bytes:
        self.bit_times += 10 + 9 * (what if isinstance(what, int) else len(what))
        if not self.start(address, isinstance(what, int)):
            raise NackError(f"0x{address:02x}")
        if len(self._chips) == 1 and self._mux is None:  # most of a day: no other chip shares the wires
            alone = self._chips[0]
            if isinstance(what, int):
                return bytes([alone.get() for _ in range(what)])
            for byte in what:
                alone.put(byte)
            return b""
        if isinstance(what, int):
            return bytes([self.get() for _ in range(what)])
        for byte in what:
            self.put(byte)
        return b""
