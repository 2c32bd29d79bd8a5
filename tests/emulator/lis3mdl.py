"""The LIS3MDL, register by register, as public drivers, ST DocID024204 and AN4602 describe it.

The data sheet could not be read here: facts that the drivers do not state are from memory.
"""

from __future__ import annotations

try:
    from emulator.register_chip import RegisterChip
except ImportError:  # run by a Python that has this folder on its path, and not the one above
    from register_chip import RegisterChip  # type: ignore[no-redef]


class Lis3mdl(RegisterChip):
    """ST in CTRL_REG1 adds `own_field_gauss` after a delay (AN4602: 60 ms)."""

    address = 0x1C
    sensitivity_per_k = -0.0003
    own_field_gauss = (2.0, 2.0, 0.5)

    def power_on(self) -> None:
        self.reset({0x0F: 0x3D, 0x20: 0x10, 0x22: 0x03})
        self.unread: set[int] = set()
        self.tests_since_s = 0.0

    def number(self) -> int:
        return self.pointer & 0x7F

    def advance(self) -> None:
        if self.pointer & 0x80:  # without this bit all bytes go to one register
            # After the last output the register number returns to the first: temperature needs a transfer of its own.
            self.pointer = 0x80 | (0x28 if self.number() == 0x2D else (self.number() + 1) & 0x7F)

    def written(self, register: int, value: int) -> None:
        if register == 0x21 and value & 0x04:  # SOFT_RST
            self.power_on()
        elif 0x20 <= register <= 0x24:
            if register == 0x20 and value & 0x01 and not self.registers[0x20] & 0x01:
                self.tests_since_s = self.time_s()
            self.registers[register] = value
            if register in (0x20, 0x22):
                self.next_conversion_s = None
                if self.registers[0x22] & 3 == 1:  # single: the turn-on time of the performance (AN4602)
                    self.begin((1.2e-3, 1.65e-3, 3.23e-3, 6.4e-3)[self.registers[0x20] >> 5 & 3])
                elif self.registers[0x22] & 3 == 0:
                    self.begin(self._period_s(), self.phase_s)

    def _period_s(self) -> float:
        first = self.registers[0x20]
        if first & 0x02:  # FAST_ODR: as fast as the performance allows
            return 1.0 / (1000, 560, 300, 155)[first >> 5 & 3]
        return 1.0 / (0.625, 1.25, 2.5, 5, 10, 20, 40, 80)[first >> 2 & 7]

    def following_s(self) -> float | None:
        if self.registers[0x22] & 3 == 1:
            self.registers[0x22] |= 0x03  # a single conversion ends in power-down
            return None
        return self._period_s()

    def convert(self) -> None:
        lsb = (6842, 3421, 2281, 1711)[self.registers[0x21] >> 5 & 3]
        made = 0.0
        if self.registers[0x20] & 0x01:
            made = min(1.0, (self.time_s() - self.tests_since_s) / 60e-3)
        for axis, (gauss, own) in enumerate(zip(self.sensed_gauss(), self.own_field_gauss, strict=True)):
            clipped = max(-32768, min(32767, round((gauss + made * own) * lsb)))
            self.registers[0x28 + 2 * axis : 0x2A + 2 * axis] = clipped.to_bytes(2, "little", signed=True)
        overrun = 0xF0 if self.registers[0x27] & 0x08 else 0
        self.registers[0x27] = overrun | 0x0F
        self.unread = set(range(0x28, 0x2E))
        if self.registers[0x20] & 0x80:
            raw = round((self.temperature_c - 25.0) * 8)
            self.registers[0x2E:0x30] = raw.to_bytes(2, "little", signed=True)

    def value(self, register: int) -> int:
        value = super().value(register)
        self.unread.discard(register)
        if not self.unread:
            self.registers[0x27] = 0
        return value
