"""The MLX90393, command by command, as public drivers and Melexis 3901090393 describe it.

Rev. 002 could be read in part: page 13 (order of the axes: t, x, y, z) and page 16 (the status of the first SM after
power-up or reset has to be read back "in order to get valid measurement data"). Sections and tables of rev. 006 that
public drivers do not quote are from memory. Adafruit_MLX90393 issues 17 and 18: real parts take longer than the table
says; tedyapo/arduino-MLX90393 waits 1.3 times as long (`slowness`).

Unverified: that SB needs its status read as SM does; what a measurement without that shows (here: no field at all, and
no error); where in a conversion the 490 us lie that belong to no axis (here: 100 us after z, the rest before t).
"""

from __future__ import annotations

try:
    from emulator.magnetometer import Magnetometer
except ImportError:  # run by a Python that has this folder on its path, and not the one above
    from magnetometer import Magnetometer  # type: ignore[no-redef]

FACTORY = 0x0600  # the upper bits of register 0; without them its sensitivity is not the specified one
# Table 17, HALLCONF 0xC: microtesla of a count at RES 0, x and y, and z, by GAIN_SEL.
SENSITIVITY_UT = (
    (0.751, 1.210), (0.601, 0.968), (0.451, 0.726), (0.376, 0.605), (0.300, 0.484), (0.250, 0.403), (0.200, 0.323),
    (0.150, 0.242),
)  # fmt: skip
LENGTH = {0x50: 2, 0x60: 4}  # bytes of the commands that are longer than one
BURST, SINGLE, ERROR, RESET = 0x80, 0x20, 0x10, 0x04
NO_AXIS_S, AFTER_Z_S = 490e-6, 100e-6


class Mlx90393(Magnetometer):
    address = 0x0C
    sensitivity_per_k = -0.0003
    slowness = 1.0  # factor by which a conversion takes longer than in the table

    def power_on(self) -> None:
        self.acknowledged = False  # the status of an SM or SB was read since the reset
        self.start_unread = False  # the newest command returned such a status, and nobody has read it yet
        self.values = [FACTORY | 0x7C, 0x0000, 0x0000] + [0] * 61
        self.mode = 0
        self.was_reset = True
        self.measured: bytes | None = None
        self.command = b""
        self.answer = b""
        self.next_conversion_s = None

    @property
    def registers(self) -> list[int]:
        """The first three, for reports."""
        return self.values

    def started(self, reading: bool) -> None:
        self.run()
        if not reading:
            self.command = b""

    def put(self, byte: int) -> None:
        self.command += bytes((byte,))
        if len(self.command) == LENGTH.get(self.command[0] & 0xF0, 1):
            self.answer = self.obeyed(self.command[0] & 0xF0, self.command[0] & 0x0F)

    def get(self) -> int:
        if self.start_unread:
            self.start_unread, self.acknowledged = False, True
        byte, self.answer = (self.answer[0], self.answer[1:]) if self.answer else (0xFF, b"")
        return byte

    def status(self, error: bool = False, words: int = 0) -> int:
        shown = self.mode | (ERROR if error else 0) | (RESET if self.was_reset else 0)
        return shown | (max(0, words - 1) & 3)

    def obeyed(self, command: int, axes: int) -> bytes:
        self.start_unread = command in (0x10, 0x30)
        if command == 0x10:  # SB
            self._measure(BURST, axes)
        elif command == 0x30:  # SM
            self._measure(SINGLE, axes)
        elif command == 0x40:  # RM
            return self._handed_out()
        elif command == 0x50:  # RR: not in a burst
            if self.mode:
                return bytes((self.status(error=True), 0xFF, 0xFF))
            value = self.values[self.command[1] >> 2]
            return bytes((self.status(words=1), value >> 8, value & 0xFF))
        elif command == 0x60:  # WR
            if self.mode:
                return bytes((self.status(error=True),))
            self.values[self.command[3] >> 2] = self.command[1] << 8 | self.command[2]
        elif command == 0x80:  # EX
            self.mode, self.next_conversion_s, self.was_reset = 0, None, False
        elif command == 0xF0:  # RT
            self.power_on()
        elif command:
            return bytes((self.status(error=True),))
        return bytes((self.status(),))

    def _measure(self, mode: int, axes: int) -> None:
        self.mode, self.axes, self.measured = mode, axes or self.values[1] >> 6 & 0x0F, None
        self.was_reset = False
        self.begin(self._conversion_s(), self.phase_s if mode == BURST else 0.0)
        oversampling, filtering = self.values[2] & 3, self.values[2] >> 2 & 7
        if (oversampling, filtering) in ((0, 0), (0, 1), (1, 0)) and self.values[0] & 0x0F == 0x0C:
            self.next_conversion_s = None  # not permitted (table 18): it never ends

    def _handed_out(self) -> bytes:
        asked = self.command[0] & 0x0F
        if self.measured is None or asked != self.axes:
            return bytes((self.status(error=True),)) + b"\xff" * 8
        block, self.measured = self.measured, None
        return bytes((self.status(words=len(block) // 2),)) + block

    def _conversion_s(self) -> float:
        """Table 18 for three axes, and what it omits: the temperature."""
        axes = bin(self.axes >> 1).count("1")
        temperature_s = (67 + 192 * 2 ** (self.values[2] >> 11 & 3)) * 1e-6 if self.axes & 1 else 0.0
        return self.slowness * (axes * self._axis_s() + temperature_s + NO_AXIS_S)

    def _axis_s(self) -> float:
        oversampling, filtering = self.values[2] & 3, self.values[2] >> 2 & 7
        return (67 + 64 * 2**oversampling * (2 + 2**filtering)) * 1e-6

    def following_s(self) -> float | None:
        if self.mode == SINGLE:
            self.mode = 0
            return None
        return self._conversion_s() + 20e-3 * (self.values[1] & 0x3F)

    def convert(self) -> None:
        words = [round(46244 + 45.2 * (self.temperature_c - 25.0))] if self.axes & 1 else []
        measured = [axis for axis in range(3) if self.axes >> (axis + 1) & 1]
        stretch = self.slowness * (1.0 + self.clock_error)
        begin_s = self.converted_s - stretch * (AFTER_Z_S + len(measured) * self._axis_s())
        field = [0.0, 0.0, 0.0]
        for axis in measured:  # one after the other
            end_s = begin_s + stretch * self._axis_s()
            field[axis] = self.field_during(begin_s, end_s)[axis]
            begin_s = end_s
        sensed = self.sensed_gauss(field)
        words += [self._output(axis, sensed[axis] if self.acknowledged else 0.0) for axis in measured]
        self.measured = b"".join(word.to_bytes(2, "big") for word in words)

    def _output(self, axis: int, gauss: float) -> int:
        """16 of the 19 bits. The converter itself ends at ±22000 counts of RES 2."""
        step_ut = SENSITIVITY_UT[self.values[0] >> 4 & 7][axis == 2]
        if self.values[0] & ~0x7F != FACTORY:
            step_ut *= 1.3
        whole = max(-88000, min(88000, round(gauss * 100.0 / step_ut)))
        resolution = self.values[2] >> (5, 7, 9)[axis] & 3
        zero = (0, 0, 0x8000, 0x4000)[resolution]
        return ((whole >> resolution) + zero) & 0xFFFF
