"""Shared by the MMC5983MA and the MMC5603NJ: a magnetised film, pulses that turn it, and measurements that take time.

S: MEMSIC MMC5983MA data sheet, Rev A, 2019-04-03 (read). D: independent drivers agree. U: users measured it.
Film: S p. 18 (after SET the output is +H + offset, after RESET -H + offset), S p. 2 (a field above 10 G changes it
until the next pulse; SET/RESET repeats to 1 mG; null field up to 0.5 G), S p. 9 (left-handed after SET: z points into
the board), D the maker's sample code in DRNadler/MMC5983MA_CompassTest and ArduPilot AP_Compass_MMC5xx3 (a pause of
0.5 to 1 ms between a pulse and a measurement).
Automatic set/reset: U DRNadler/MMC5983MA_CompassTest (SET, sample, RESET, sample, half the difference; twice the time
and about 1 ms), U SlimeVR-Tracker-nRF issue 150, S p. 2 (at most 50/100/225/580 Hz).

Unverified, and chosen here: a new TM_M restarts a measurement that runs; how wrong a measurement is soon after a pulse,
with an upset film or in the strong field itself; that writing 1 to Meas_M_Done clears the bit and not only its
interrupt (`writing_clears_done`).
A strong field in `field_at` is noticed at each measurement and at each transfer, not in between.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random

try:
    from emulator.register_chip import RegisterChip
except ImportError:  # run by a Python that has this folder on its path, and not the one above
    from register_chip import RegisterChip  # type: ignore[no-redef]

TM_M, SET, RESET, AUTO_SR_EN = 0x01, 0x08, 0x10, 0x20  # control 0 of both
SW_RST = 0x80  # control 1 of both


class Film:
    """`polarity`: 1 after SET, -1 after RESET. A part just after power-on may have either polarity; here it has that of
    RESET."""

    def __init__(self, random: Random) -> None:
        self.random = random
        self.polarity = -1
        self.upset = False
        self.zero_gauss = [0.0, 0.0, 0.0]  # state after the newest pulse
        self.pulsed_s = -math.inf

    def pulse(self, polarity: int, time_s: float, repeatability_gauss: float) -> None:
        self.polarity, self.upset, self.pulsed_s = polarity, False, time_s
        self.zero_gauss = [self.random.gauss(0.0, repeatability_gauss) for _ in range(3)]


class Memsic(RegisterChip):
    """zero_gauss: the bridges' reading at zero field. coil_gauss: the self-test coil's field. Both by the chip's
    axes."""

    address = 0x30
    sensitivity_per_k = -0.0002
    status = 0
    done = 0
    otp_read_done = 0x10
    control_0 = 0
    zero_count = 0
    counts_per_gauss = 16384
    measurements_s: tuple[float, ...] = ()  # by bandwidth
    noises_gauss: tuple[float, ...] = ()
    between_pulses_s = 0.0  # extra time of an automatic set/reset, beyond its two samples
    settles_s = 0.0  # after a pulse
    reset_s = 0.0
    upsetting_gauss = 0.0
    remanence_gauss = 0.3  # of an upset film
    upset_sensitivity = 0.5  # sensitivity of an upset film, once the strong field is gone
    strong_sensitivity = 1.0  # as long as the strong field lasts, so that it is noticed
    unsettled_gauss = 0.2  # the error of a measurement that begins right at a pulse
    repeatability_gauss = 1e-3
    zero_gauss: Sequence[float] = (0.0, 0.0, 0.0)
    coil_gauss: Sequence[float] = (0.125, 0.125, 0.125)
    writing_clears_done = True

    def __init__(
        self,
        time_s: Callable[[], float],
        field_gauss: Sequence[float] = (0.0, 0.0, 0.0),
        clock_error: float = 0.0,
        phase_s: float = 0.0,
        address: int | None = None,
        noise_gauss: float = 0.0,
        seed: int = 1,
    ) -> None:
        self.film = Film(Random(1000 + seed))
        super().__init__(time_s, field_gauss, clock_error, phase_s, address, noise_gauss, seed)

    def restart(self, registers: dict[int, int]) -> None:
        """Registers start anew. The film stays as it is: no pulse is among these."""
        self.reset(registers)
        self.controls = bytearray(4)
        self.starts_until_s = -math.inf
        self.sample_s, self.automatic, self.exactly = 0.0, False, False

    def exposed(self, field_gauss: Sequence[float]) -> None:
        self.film.upset |= self._is_strong(field_gauss)

    def _is_strong(self, field_gauss: Sequence[float]) -> bool:
        return math.hypot(*field_gauss) > self.upsetting_gauss

    def run(self) -> None:
        super().run()
        now_s = self.time_s()
        self.exposed(self.field_during(now_s, now_s))

    def own_noise_gauss(self) -> float:
        return self.noises_gauss[self.controls[1] & 3]

    def written(self, register: int, value: int) -> None:
        if self.time_s() < self.starts_until_s - 1e-9:
            return  # the chip ignores commands while it starts
        number = register - self.control_0
        if register == self.status and self.writing_clears_done:
            self.registers[register] &= ~(value & self.done)
        elif number == 1 and value & SW_RST:
            self.power_on()
            self.starts_until_s = self.time_s() + self.reset_s
        elif number == 0:
            self._command(value)
        elif 0 < number < len(self.controls):
            self.controls[number] = value
            self.configured(number)

    def configured(self, number: int) -> None:
        """A control other than the first was written."""
        if number == 2:
            self.next_conversion_s = None
            period_s = self.following_s()
            if period_s is not None:
                self.begin(period_s, self.phase_s)

    def value(self, register: int) -> int:
        return 0 if 0 <= register - self.control_0 < len(self.controls) else super().value(register)

    def _command(self, value: int) -> None:
        self.controls[0] = value & ~(TM_M | SET | RESET)  # these clear themselves
        if value & (SET | RESET):
            self._pulse(1 if value & SET else -1, self.time_s())
        if value & TM_M:
            self.registers[self.status] &= ~self.done
            self.exactly = value == TM_M | AUTO_SR_EN
            self.begin(self.measurement_s())

    def _pulse(self, polarity: int, time_s: float) -> None:
        self.film.pulse(polarity, time_s, self.repeatability_gauss)

    def measurement_s(self) -> float:
        """The duration of a measurement that begins now."""
        self.sample_s = self.measurements_s[self.controls[1] & 3]
        self.automatic = bool(self.controls[0] & AUTO_SR_EN)
        return 2.0 * self.sample_s + self.between_pulses_s if self.automatic else self.sample_s

    def coil_current(self) -> int:
        raise NotImplementedError

    def convert(self) -> None:
        sample_s, end_s = self.sample_s * (1.0 + self.clock_error), self.converted_s
        if self.automatic:
            pause_s = 0.5 * self.between_pulses_s * (1.0 + self.clock_error)
            self._pulse(1, end_s - 2.0 * (sample_s + pause_s))
            after_set = self._sample(end_s - 2.0 * sample_s - pause_s, end_s - sample_s - pause_s, settled=True)
            self._pulse(-1, end_s - sample_s - pause_s)
            after_reset = self._sample(end_s - sample_s, end_s, settled=True)
            counts = [(a - b) / 2.0 for a, b in zip(after_set, after_reset, strict=True)]
        else:
            counts = self._sample(end_s - sample_s, end_s)
        largest = self.zero_count - 1
        self.show([self.zero_count + max(-self.zero_count, min(largest, round(count))) for count in counts])
        self.registers[self.status] |= self.done

    def show(self, counts: list[int]) -> None:
        """These counts go to the outputs."""
        raise NotImplementedError

    def _sample(self, begin_s: float, end_s: float, settled: bool = False) -> list[float]:
        """Counts from the middle of the range at this time. A pulse in the middle of it spoils it as much as one at its
        beginning."""
        field = self.field_during(begin_s, end_s)
        self.exposed(field)
        film = self.film
        age_s = max(0.0, begin_s - film.pulsed_s)
        error = 0.0 if settled else self.unsettled_gauss * max(0.0, 1.0 - (age_s + 1e-9) / self.settles_s)
        sensitivity, remanence = 1.0, 0.0
        if film.upset:
            sensitivity = self.strong_sensitivity if self._is_strong(field) else self.upset_sensitivity
            remanence = self.remanence_gauss
        x, y, out = self.sensed_gauss(field)
        counts = []
        for axis, gauss in enumerate((x, y, -out)):
            sensed = film.polarity * sensitivity * (gauss + self.coil_current() * self.coil_gauss[axis])
            shown = sensed + self.zero_gauss[axis] + film.zero_gauss[axis] + remanence + error
            counts.append(max(-self.zero_count, min(self.zero_count - 1, shown * self.counts_per_gauss)))
        return counts
