"""The QMC5883L and the QMC5883P, register by register.

Sources of the QMC5883L: QST 13-52-04 as public drivers quote it (PX4 `qmc5883l`, ArduPilot `AP_Compass_QMC5883L`,
Tasmota). Both PX4 and ArduPilot read register 0x00 once before they ask for the identity.

Sources of the QMC5883P: ArduPilot `AP_Compass_QMC5883P`, Adafruit_QMC5883P, lionyhw/MQC5883P_nrf52 and
reznikmm/qmc5883p (`source/qmc5883p-raw.ads` quotes the data sheet: OVFL is set beyond ±30000 counts, the outputs
saturate at -32768 and 32767). The last one alone says that reading the status clears DRDY and OVFL (`cleared_by`).
Unverified, and so an attribute or a choice made here: which axes are turned as long as 0x29 was not written, how long
single measurements take, how fast mode "continuous" is, and the noise at other ranges than ±2 G.
"""

from __future__ import annotations

from typing import Literal

try:
    from emulator.register_chip import RegisterChip
except ImportError:  # run by a Python that has this folder on its path, and not the one above
    from register_chip import RegisterChip  # type: ignore[no-redef]

RATES_HZ = (10, 50, 100, 200)
NOISE_GAUSS = 2e-3  # QMC5883L data sheet, ±2 G, 512 times oversampled, as drivers quote it; no other figure is known


class Qmc5883l(RegisterChip):
    """`woken`: register 0x00 was read since power-on; before that the identity reads as zero."""

    address = 0x0D
    sensitivity_per_k = -0.0005

    def power_on(self) -> None:
        self.reset({0x0D: 0xFF})
        self.woken = False

    def own_noise_gauss(self) -> float:
        return NOISE_GAUSS

    def written(self, register: int, value: int) -> None:
        if register == 0x0A and value & 0x80:  # SOFT_RST
            self.reset({0x0D: 0xFF})
        elif register in (0x09, 0x0A, 0x0B):
            self.registers[register] = value
            if register == 0x09:
                self.next_conversion_s = None
                if value & 3 == 1:
                    self.begin(self.following_s(), self.phase_s)

    def following_s(self) -> float:
        return 1.0 / RATES_HZ[self.registers[0x09] >> 2 & 3]

    def convert(self) -> None:
        lsb = (12000, 3000, 0, 0)[self.registers[0x09] >> 4 & 3]
        counts = [round(gauss * lsb) for gauss in self.sensed_gauss()]
        skipped = self.registers[0x06] & 1  # the previous sample was not read: DOR
        overflow = any(not -32768 <= count <= 32767 for count in counts)
        for axis, count in enumerate(counts):
            clipped = max(-32768, min(32767, count))
            self.registers[2 * axis : 2 * axis + 2] = clipped.to_bytes(2, "little", signed=True)
        self.registers[0x06] = 1 | overflow << 1 | skipped << 2

    def value(self, register: int) -> int:
        value = super().value(register)
        if register == 0x00:
            self.woken = True
        if register <= 0x05:  # reading any output clears DRDY and DOR
            self.registers[0x06] &= 0x02
        return 0 if register == 0x0D and not self.woken else value

    def advance(self) -> None:
        rolls_over = self.registers[0x0A] & 0x40 and self.pointer == 0x06
        self.pointer = 0 if rolls_over else (self.pointer + 1) & 0xFF


class Qmc5883p(RegisterChip):
    """Sold under the names QMC5883L and HMC5883L, and another chip than both. Its axes are right-handed."""

    address = 0x2C
    sensitivity_per_k = -0.0005  # as of the QMC5883L; unverified
    cleared_by: Literal["status", "data"] = "status"  # the read that clears DRDY
    turned = (-1, -1, 1)  # signs of the axes before 0x29 = 0x06; unverified
    single_s = 5e-3  # unverified: no longer than a period of the highest rate of mode "normal"

    def power_on(self) -> None:
        self.reset({0x00: 0x80})
        self.signs_defined = False

    def own_noise_gauss(self) -> float:
        return NOISE_GAUSS

    def written(self, register: int, value: int) -> None:
        if register == 0x0B and value & 0x80:  # SOFT_RST
            self.power_on()
        elif register == 0x29:
            self.signs_defined = value == 0x06
        elif register in (0x0A, 0x0B):
            self.registers[register] = value
            if register == 0x0A:
                self.next_conversion_s = None
                mode = value & 3
                if mode == 2:
                    self.begin(self.single_s)
                elif mode:
                    self.begin(self._period_s(), self.phase_s)

    def _period_s(self) -> float:
        """Mode 3 never sleeps: as fast as eightfold oversampling permits; unverified."""
        control = self.registers[0x0A]
        return self.single_s if control & 3 == 3 else 1.0 / RATES_HZ[control >> 2 & 3]

    def following_s(self) -> float | None:
        if self.registers[0x0A] & 3 == 2:
            self.registers[0x0A] &= ~3  # a single measurement ends in suspend
            return None
        return self._period_s()

    def convert(self) -> None:
        lsb = (1000, 2500, 3750, 15000)[self.registers[0x0B] >> 2 & 3]
        signs = (1, 1, 1) if self.signs_defined else self.turned
        status = self.registers[0x09] & 0x02 | 0x01
        for axis, (gauss, sign) in enumerate(zip(self.sensed_gauss(), signs, strict=True)):
            count = max(-32768, min(32767, round(sign * gauss * lsb)))
            if not -30000 <= count <= 30000:
                status |= 0x02
            self.registers[1 + 2 * axis : 3 + 2 * axis] = count.to_bytes(2, "little", signed=True)
        self.registers[0x09] = status

    def value(self, register: int) -> int:
        value = super().value(register)
        if register == 0x09:
            self.registers[0x09] &= 0x01 if self.cleared_by == "data" else 0x00
        elif 0x01 <= register <= 0x06 and self.cleared_by == "data":
            self.registers[0x09] &= 0x02
        return value
