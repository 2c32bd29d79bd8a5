"""Simulates HMC5983 chips: counts at a gain, with noise, saturation, and a clock in each chip.

Noise: 2 mG rms (data sheet 900425, resolution at ±0.88 G), taken as the field noise in every range. The coarser steps
of wider ranges add to it. That it does not grow with the range is an assumption.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array
from fmfts.sensor.chips.hmc5983 import LARGEST_COUNT, LSB_PER_GAUSS, OVERFLOW_COUNT
from fmfts.sensor.frame import TESLA_PER_GAUSS

NOISE_T = 2e-3 * TESLA_PER_GAUSS
CLOCK_TOLERANCE = 0.03
SINGLE_CONVERSION_S = 6e-3
SENSITIVITY_PER_K = {"hmc5983": -0.0003, "hmc5883l": -0.003}  # with and without the chip's own compensation


class ChipArray:
    """N chips. trigger "free": each converts by its own clock, at `rate_hz` ± 3 %; "simultaneous": all on command."""

    def __init__(
        self,
        count: int,
        rate_hz: float,
        trigger: Literal["free", "simultaneous"],
        chip: Literal["hmc5983", "hmc5883l"],
        noise_t: float,
        random: np.random.Generator,
    ) -> None:
        self._random = random
        self._noise_t = noise_t
        self._sensitivity_per_k = SENSITIVITY_PER_K[chip]
        if trigger == "free":
            self._period_s = (1.0 + random.uniform(-CLOCK_TOLERANCE, CLOCK_TOLERANCE, count)) / rate_hz
            self._first_s = -random.uniform(0.0, 1.0, count) * self._period_s
        else:
            self._period_s = np.full(count, 1.0 / rate_hz)
            self._first_s = np.full(count, -SINGLE_CONVERSION_S)

    def newest_conversion(self, time_s: float | Array) -> NDArray[np.int64]:
        """(…, N) number of each chip's newest conversion. time_s: a number, or (…, 1)."""
        return np.floor((time_s - self._first_s) / self._period_s).astype(np.int64)

    def time_of(self, conversion: NDArray[np.int64]) -> Array:
        """(…, N) times of the conversions (…, N), in s."""
        return self._first_s + conversion * self._period_s

    def counts(self, field_t: Array, gain_code: int, warming_k: float) -> NDArray[np.int16]:
        """Readings (…, N, 3) of `field_t` (…, N, 3) in each chip's own axes, at 25 °C + `warming_k`."""
        noisy = field_t + self._noise_t * self._random.standard_normal(field_t.shape)
        sensitivity = (1.0 + self._sensitivity_per_k * warming_k) * LSB_PER_GAUSS[gain_code] / TESLA_PER_GAUSS
        counts = np.rint(noisy * sensitivity)
        return np.where(np.abs(counts) > LARGEST_COUNT, OVERFLOW_COUNT, counts).astype(np.int16)
