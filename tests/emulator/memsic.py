"""The MMC5983MA and the MMC5603NJ, register by register; memsic_film.py has what they share.

MMC5983MA: MEMSIC data sheet, Rev A, 2019-04-03, pages 2 and 13 to 16. SparkFun_MMC5983MA library, issues 9, 10 and 12:
with a command byte of exactly 0x21, users see x of every 16th sample off by 10 to 12 uT. Its controls cannot be read.
Unverified: Auto_SR_en doubles every continuous measurement, whatever Prd_set says.

MMC5603NJ: Linux drivers/iio/magnetometer/mmc5633, Zephyr drivers/sensor/memsic/mmc56x3, Adafruit_MMC56x3,
mgershow/MMC5603NJ and PebbleOS (registers, bits, times, rates), SlimeVR (polarity).
Unverified: its handedness, the field that upsets its film, its noise at bandwidths other than 00, when it sets
Sat_sensor, and that an automatic set/reset takes just twice the time (its fastest rates fit that).
"""

from __future__ import annotations

import math

try:
    from emulator.memsic_film import AUTO_SR_EN, Memsic
except ImportError:  # run by a Python that has this folder on its path, and not the one above
    from memsic_film import AUTO_SR_EN, Memsic  # type: ignore[no-redef]


class Mmc5983ma(Memsic):
    """Continuous mode: S p. 16. A measurement longer than its period skips to the end of the next one."""

    status = 0x08
    done = 0x01
    control_0 = 0x09
    zero_count = 131072
    measurements_s: tuple[float, ...] = (8e-3, 4e-3, 2e-3, 0.5e-3)  # S p. 15
    noises_gauss: tuple[float, ...] = (0.4e-3, 0.6e-3, 0.8e-3, 1.2e-3)  # S p. 2
    fastest_hz = (50, 100, 225, 580)  # with automatic set/reset, S p. 2
    between_pulses_s = 1e-3
    settles_s = 0.5e-3
    reset_s = 10e-3  # S p. 15
    upsetting_gauss = 10.0  # S p. 2
    odd_gauss = 0.11  # on x of each 16th sample after the command 0x21

    def power_on(self) -> None:
        self.restart({0x08: self.otp_read_done, 0x2F: 0x30})
        self.asked_exactly = 0

    def following_s(self) -> float | None:
        if not (self.controls[2] & 0x08 and self.controls[2] & 0x07):  # Cmm_en, Cm_freq
            return None
        period_s = 1.0 / (0, 1, 10, 20, 50, 100, 200, 1000)[self.controls[2] & 7]
        period_s *= math.ceil(self.measurement_s() / period_s - 1e-9)
        return max(period_s, 1.0 / self.fastest_hz[self.controls[1] & 3]) if self.automatic else period_s

    def coil_current(self) -> int:
        return (self.controls[3] >> 1 & 1) - (self.controls[3] >> 2 & 1)  # St_enp, St_enm

    def show(self, counts: list[int]) -> None:
        if self.exactly:
            self.asked_exactly += 1
            if self.asked_exactly % 16 == 0:
                counts[0] = min(2 * self.zero_count - 1, counts[0] + round(self.odd_gauss * self.counts_per_gauss))
        self.exactly = False
        low = self.registers[0x06]
        for axis, count in enumerate(counts):
            inhibited = 0x18 if axis else 0x04
            if self.controls[1] & inhibited == inhibited:
                continue
            self.registers[2 * axis : 2 * axis + 2] = (count >> 2).to_bytes(2, "big")
            low = low & ~(3 << (6 - 2 * axis)) | (count & 3) << (6 - 2 * axis)
        self.registers[0x06] = low


class Mmc5603nj(Memsic):
    """Continuous mode: the rate in 0x1A, Cmm_freq_en, then Cmm_en; with automatic set/reset at most 75 to 255 Hz."""

    status = 0x18
    done = 0x40
    control_0 = 0x1B
    zero_count = 524288
    measurements_s: tuple[float, ...] = (6.6e-3, 3.5e-3, 2.0e-3, 1.2e-3)
    # 2 mG by the vendor; shorter measurements are noisier by the square root of the time.
    noises_gauss: tuple[float, ...] = (2.0e-3, 2.75e-3, 3.63e-3, 4.69e-3)
    settles_s = 1e-3
    reset_s = 20e-3
    upsetting_gauss = 32.0

    def power_on(self) -> None:
        self.restart({0x18: self.otp_read_done, 0x39: 0x10})
        self.rate_hz, self.period_s = 0, 0.0

    def written(self, register: int, value: int) -> None:
        super().written(register, value)
        if register == 0x1A and self.time_s() >= self.starts_until_s - 1e-9:
            self.rate_hz = value
        elif register == self.control_0 and value & 0x80 and self.rate_hz:  # Cmm_freq_en
            fastest_hz = (75, 150, 255, 255)[self.controls[1] & 3]
            self.period_s = 1.0 / min(self.rate_hz, fastest_hz)

    def following_s(self) -> float | None:
        if not (self.controls[2] & 0x10 and self.period_s):  # Cmm_en
            return None
        period_s = self.period_s
        if self.controls[2] & 0x80 and self.rate_hz == 255:  # hpower
            period_s = 1e-3
        samples = 2 if self.controls[0] & AUTO_SR_EN else 1
        self.measurement_s()
        self.sample_s = min(self.sample_s, period_s / samples)
        return period_s

    def coil_current(self) -> int:
        return (self.controls[1] >> 5 & 1) - (self.controls[1] >> 6 & 1)  # St_enp, St_enm

    def show(self, counts: list[int]) -> None:
        for axis, count in enumerate(counts):
            if not self.controls[1] >> (2 + axis) & 1:  # else inhibited
                self.registers[2 * axis : 2 * axis + 2] = (count >> 4).to_bytes(2, "big")
                self.registers[0x06 + axis] = (count & 0x0F) << 4
        if self.controls[0] & 0x40:  # Auto_ST_en
            saturated = self.film.upset or min(counts) == 0 or max(counts) == 2 * self.zero_count - 1
            self.registers[0x18] = self.registers[0x18] & ~0x20 | saturated << 5
