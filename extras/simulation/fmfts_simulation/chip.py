"""Simulates chips: counts at a gain, with noise, saturation, and a clock in each chip.

Noise: that of the smallest range (data sheet), taken as the field noise in every range. The coarser steps of wider
ranges add to it. That it does not grow with the range is an assumption.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array
from fmfts.sensor.chips import TESLA_PER_GAUSS, Chip


class ChipArray:
    """N chips. trigger "free": each converts by its own clock, at `rate_hz` ± 3 %; "simultaneous": all on command."""

    def __init__(
        self,
        count: int,
        rate_hz: float,
        trigger: Literal["free", "simultaneous"],
        chip: Chip,
        noise_t: float,
        random: np.random.Generator,
    ) -> None:
        self._random = random
        self._noise_t = noise_t
        self._chip = chip
        if trigger == "free":
            self._period_s = (1.0 + random.uniform(-chip.clock_tolerance, chip.clock_tolerance, count)) / rate_hz
            self._first_s = -random.uniform(0.0, 1.0, count) * self._period_s
        else:
            self._period_s = np.full(count, 1.0 / rate_hz)
            self._first_s = np.full(count, -chip.single_conversion_s)

    def newest_conversion(self, time_s: float | Array) -> NDArray[np.int64]:
        """(…, N) number of each chip's newest conversion. time_s: a number, or (…, 1)."""
        return np.floor((time_s - self._first_s) / self._period_s).astype(np.int64)

    def time_of(self, conversion: NDArray[np.int64]) -> Array:
        """(…, N) times of the conversions (…, N), in s."""
        return self._first_s + conversion * self._period_s

    def counts(self, field_t: Array, gain_code: int, warming_k: float) -> NDArray[np.int16]:
        """Readings (…, N, 3) of `field_t` (…, N, 3) in each chip's own axes, at 25 °C + `warming_k`."""
        noisy = field_t + self._noise_t * self._random.standard_normal(field_t.shape)
        nominal = np.array(self._chip.counts_per_gauss[gain_code])
        sensitivity = (1.0 + self._chip.sensitivity_per_k * warming_k) * nominal / TESLA_PER_GAUSS
        return as_counts(self._chip, noisy * sensitivity)


def as_counts(chip: Chip, counts: Array) -> NDArray[np.int16]:
    """The converter's output for real numbers of counts: the saturated count if they are too large."""
    whole = np.rint(counts)
    return np.where(np.abs(whole) > chip.largest_count, chip.saturated_count, whole).astype(np.int16)
