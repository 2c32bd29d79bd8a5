"""What a kind of magnetometer is: every number that depends on the chip. One file of this folder describes each."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

TESLA_PER_GAUSS = 1e-4
GAIN_CODES = 8  # what the three bits of the wire can name (docs/wire.md); a chip may have fewer

Axes = tuple[int, int, int]
PerAxis = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Thermometer:
    """Temperature registers: `at_zero_c` + count · `c_per_count`. range_c: where the chip works; it tells no other."""

    at_zero_c: float
    c_per_count: float
    range_c: tuple[float, float]


@dataclass(frozen=True, slots=True)
class BiasStrap:
    """The self-test: a strap on the chip makes a known field, and a good axis shows counts within `limits`.

    field_gauss: nominal, per axis; its own tolerance is inside the limits. limits: least and largest count of a good
    axis at `gain_code`, of either sign. deviation: of the strap's field from one axis to another, as a fraction.
    """

    gain_code: int
    limits: tuple[int, int]
    field_gauss: PerAxis
    deviation: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chip:
    """The facts of one kind of chip. `name` is for the configuration, `label` for people.

    ranges_gauss, counts_per_gauss: by gain code; the second for each axis x, y, z.
    largest_count: what the converter can tell, of either sign (and −largest_count − 1). saturated_count: what it says
    instead where the field is larger.
    output_rates_hz: by the chip's rate code, slowest first; free_rate_hz: the highest that this chip has.
    single_rate_hz, single_conversion_s, single_wait_s: of measurements at the host's word; the wait is long enough for
    the slowest chip. clock_tolerance: relative, of the chip's own clock.
    noise_t: standard deviation of one sample. sensitivity_per_k: relative change of the counts with temperature.
    thermometer: None where the chip has none.
    """

    name: str
    label: str
    address: int
    identity: bytes
    ranges_gauss: tuple[float, ...]
    counts_per_gauss: tuple[PerAxis, ...]
    largest_count: int
    saturated_count: int
    output_rates_hz: tuple[float, ...]
    free_rate_hz: int
    single_rate_hz: int
    single_conversion_s: float
    single_wait_s: float
    clock_tolerance: float
    noise_t: float
    sensitivity_per_k: float
    thermometer: Thermometer | None
    bias_strap: BiasStrap
    # (GAIN_CODES, 3) the field of one count in tesla, by gain code and axis; NaN where the chip has no such code.
    step_t: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        steps = np.full((GAIN_CODES, 3), np.nan)
        steps[: len(self.counts_per_gauss)] = TESLA_PER_GAUSS / np.array(self.counts_per_gauss, dtype=float)
        steps.setflags(write=False)
        object.__setattr__(self, "step_t", steps)

    def gain_code_for_range(self, range_gauss: float) -> int:
        """The gain code whose range is `range_gauss`; ValueError names the ranges that exist."""
        for code, value in enumerate(self.ranges_gauss):
            if abs(value - range_gauss) < 1e-9:
                return code
        raise ValueError(f"the chip has no range of ±{range_gauss} G: one of {', '.join(map(str, self.ranges_gauss))}")

    def highest_rate_hz(self, trigger: str) -> int:
        """What the chip can deliver: by itself ("free"), or at the host's word ("simultaneous")."""
        return self.single_rate_hz if trigger == "simultaneous" else self.free_rate_hz

    def output_rate_hz(self, rate_hz: float) -> float:
        """The chip's slowest own rate that is not below `rate_hz`; ValueError where there is none."""
        for rate in self.output_rates_hz:
            if rate_hz <= rate <= self.free_rate_hz:
                return rate
        raise ValueError(f"the {self.name} delivers at most {self.free_rate_hz} Hz, not {rate_hz:g} Hz")

    def temperature_c(self, count: int) -> float | None:
        """None where the chip has no thermometer, or could not work: its registers then mean nothing."""
        thermometer = self.thermometer
        return None if thermometer is None else self.believed_c(thermometer.at_zero_c + count * thermometer.c_per_count)

    def believed_c(self, temperature_c: float | None) -> float | None:
        """The temperature, or None where this chip cannot have told it."""
        if temperature_c is None or self.thermometer is None:
            return None
        lowest_c, highest_c = self.thermometer.range_c
        return temperature_c if lowest_c <= temperature_c <= highest_c else None

    def why_not_identity(self, answer: bytes) -> str | None:
        """What is wrong with the identification registers, None if nothing is.

        Necessary, not sufficient: a clone may answer the same, and fails the self-test.
        """
        if answer == self.identity:
            return None
        due = f"{self.identity.hex(' ')} ({self.identity.decode('ascii', 'replace')})"
        return (
            f"answers {answer.hex(' ')} where an {self.label} says {due}: another chip is fitted, or the bus is noisy"
        )
