"""QMC5883L, LIS3MDL and MMC5983MA, register by register; mlx90393.py has the fourth. For whatever carries transfers.

As public drivers and the data sheets (QST 13-52-04, ST DocID024204, MEMSIC rev. A) describe them. These data sheets
could not be read here: what the drivers do not tell is from memory. Pure Python without dependencies, like chips.py,
whose Bus they hang on.
"""

from __future__ import annotations

try:
    from emulator.magnetometer import Magnetometer
except ImportError:  # run by a Python that has this folder on its path, and not the one above
    from magnetometer import Magnetometer  # type: ignore[no-redef]


class RegisterChip(Magnetometer):
    """Its first byte written is a register's number. A transfer sees one sample: outputs wait while it lasts."""

    def started(self, reading: bool) -> None:
        self.run()
        self._pointer_next = not reading

    def put(self, byte: int) -> None:
        if self._pointer_next:
            self.pointer, self._pointer_next = byte, False
            return
        self.written(self.number(), byte)
        self.advance()

    def get(self) -> int:
        value = self.value(self.number())
        self.advance()
        return value

    def number(self) -> int:
        return self.pointer

    def advance(self) -> None:
        self.pointer = (self.pointer + 1) & 0xFF

    def reset(self, values: dict[int, int]) -> None:
        self.registers = bytearray(256)
        for register, value in values.items():
            self.registers[register] = value
        self.pointer, self._pointer_next = 0, False
        self.next_conversion_s = None

    def written(self, register: int, value: int) -> None:
        raise NotImplementedError

    def value(self, register: int) -> int:
        return self.registers[register]


class Qmc5883l(RegisterChip):
    address = 0x0D
    sensitivity_per_k = -0.0005

    def power_on(self) -> None:
        self.reset({0x0D: 0xFF})

    def written(self, register: int, value: int) -> None:
        if register == 0x0A and value & 0x80:  # SOFT_RST
            self.power_on()
        elif register in (0x09, 0x0A, 0x0B):
            self.registers[register] = value
            if register == 0x09:
                self.next_conversion_s = None
                if value & 3 == 1:
                    self.begin(self.following_s())

    def following_s(self) -> float:
        return 1.0 / (10, 50, 100, 200)[self.registers[0x09] >> 2 & 3]

    def convert(self) -> None:
        lsb = (12000, 3000, 0, 0)[self.registers[0x09] >> 4 & 3]
        counts = [round(gauss * lsb) for gauss in self.sensed_gauss()]
        skipped = self.registers[0x06] & 1  # the sample before was not read: DOR
        overflow = any(not -32768 <= count <= 32767 for count in counts)
        for axis, count in enumerate(counts):
            clipped = max(-32768, min(32767, count))
            self.registers[2 * axis : 2 * axis + 2] = clipped.to_bytes(2, "little", signed=True)
        self.registers[0x06] = 1 | overflow << 1 | skipped << 2

    def value(self, register: int) -> int:
        value = super().value(register)
        if register <= 0x05:  # reading any output clears DRDY and DOR
            self.registers[0x06] &= 0x02
        return value

    def advance(self) -> None:
        rolls_over = self.registers[0x0A] & 0x40 and self.pointer == 0x06
        self.pointer = 0 if rolls_over else (self.pointer + 1) & 0xFF


class Qmc5883p(RegisterChip):
    """What a scan sees of it: sold under the names of the QMC5883L, and another chip. It measures nothing here."""

    address = 0x2C

    def power_on(self) -> None:
        self.reset({0x00: 0x80})

    def written(self, register: int, value: int) -> None:
        if register in (0x0A, 0x0B):
            self.registers[register] = value


class Lis3mdl(RegisterChip):
    """ST in CTRL_REG1 adds `own_field_gauss`, which takes its time to be there (AN4602: 60 ms)."""

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
            # From the last output the number goes back to the first: temperature needs a transfer of its own.
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
                    self.begin(self._period_s())

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


class Mmc5983ma(RegisterChip):
    """A pulse magnetises its bridges: a reset pulse turns over what they make of a field, and not their own zero.

    A field of more than 10 G leaves them magnetised otherwise until the next pulse. Controls read as zero. Its z points
    into the board: its axes are left-handed. Along them: zero_gauss, what the bridges say of no field, and coil_gauss,
    what the coil makes with St_enp.
    """

    address = 0x30
    sensitivity_per_k = -0.0002
    remanence_gauss = 0.3
    zero_gauss = (0.0, 0.0, 0.0)
    coil_gauss = (0.125, 0.125, 0.125)

    def power_on(self) -> None:
        self.reset({0x08: 0x10, 0x2F: 0x30})
        self.controls = bytearray(4)
        self.magnetised, self.sense = False, 1
        self.resets_until_s = 0.0

    def written(self, register: int, value: int) -> None:
        if self.time_s() < self.resets_until_s:
            return  # it is starting: 10 ms
        if register == 0x08:
            self.registers[0x08] &= ~(value & 0x03)
        elif register == 0x0A and value & 0x80:  # SW_RST
            magnetised, sense = self.magnetised, self.sense
            self.power_on()
            self.magnetised, self.sense = magnetised, sense
            self.resets_until_s = self.time_s() + 9e-3
        elif 0x09 <= register <= 0x0C:
            self._control(register - 0x09, value)

    def _control(self, number: int, value: int) -> None:
        if number == 0:
            self.controls[0] = value & 0x64  # the other bits clear themselves
            if value & 0x18:  # set, or reset
                self._pulse(1 if value & 0x08 else -1)
            if value & 0x01:  # TM_M
                self.registers[0x08] &= ~0x01
                self.begin(self._measurement_s())
            return
        self.controls[number] = value
        if number == 2:
            self.next_conversion_s = None
            if value & 0x08 and value & 0x07:
                self.begin(self._period_s())

    def _pulse(self, sense: int) -> None:
        self.magnetised, self.sense = False, sense

    def _measurement_s(self) -> float:
        return (8e-3, 4e-3, 2e-3, 0.5e-3)[self.controls[1] & 3]

    def _period_s(self) -> float:
        """A measurement that is longer than its period takes the next one."""
        period_s = 1.0 / (0, 1, 10, 20, 50, 100, 200, 1000)[self.controls[2] & 7]
        return period_s * -(-self._measurement_s() // period_s)

    def following_s(self) -> float | None:
        return self._period_s() if self.controls[2] & 0x08 and self.controls[2] & 0x07 else None

    def convert(self) -> None:
        single = not self.controls[2] & 0x08
        if self.controls[0] & 0x20 and (single or self.controls[2] & 0x80):  # Auto_SR_en; in a stream En_prd_set, too
            self._pulse(1)
        x, y, out = self.sensed_gauss()
        sensed = (x, y, -out)
        self.magnetised |= max(map(abs, sensed)) > 10.0
        current = (self.controls[3] >> 1 & 1) - (self.controls[3] >> 2 & 1)  # St_enp, St_enm
        low = 0
        for axis, gauss in enumerate(sensed):
            offset = self.zero_gauss[axis] + (self.remanence_gauss if self.magnetised else 0.0)
            felt = self.sense * (gauss + current * self.coil_gauss[axis])
            whole = max(0, min(0x3FFFF, 0x20000 + round((felt + offset) * 16384)))
            self.registers[2 * axis : 2 * axis + 2] = (whole >> 2).to_bytes(2, "big")
            low |= (whole & 3) << (6 - 2 * axis)
        self.registers[0x06] = low
        self.registers[0x08] |= 0x01

    def value(self, register: int) -> int:
        return 0 if 0x09 <= register <= 0x0C else super().value(register)
