"""Chips as a host sees them: counts at a gain, with noise, a range that ends, and a clock of their own.

The data sheet tells the noise of the smallest range. It is taken as the field noise at every range, to which the
coarser steps of the wider ranges add their own. That it does not grow with the range is an assumption.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array
from fmfts.sensor.chips import TESLA_PER_GAUSS, Chip


class ChipArray:
    """N chips. `trigger` "free": each converts at `rate_hz` by its own clock; "simultaneous": all when told to."""

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
        """(…, N) number of each chip's newest conversion at `time_s`, a number or (…, 1)."""
        return np.floor((time_s - self._first_s) / self._period_s).astype(np.int64)

    def time_of(self, conversion: NDArray[np.int64]) -> Array:
        """(…, N) seconds."""
        return self._first_s + conversion * self._period_s

    def counts(self, field_t: Array, gain_code: int, warming_k: float) -> NDArray[np.int16]:
        """Readings (…, N, 3) of `field_t` (…, N, 3) in each chip's own axes, `warming_k` above 25 °C."""
        noisy = field_t + self._noise_t * self._random.standard_normal(field_t.shape)
        nominal = np.array(self._chip.counts_per_gauss[gain_code])
        sensitivity = (1.0 + self._chip.sensitivity_per_k * warming_k) * nominal / TESLA_PER_GAUSS
        return as_counts(self._chip, noisy * sensitivity)


def as_counts(chip: Chip, counts: Array) -> NDArray[np.int16]:
    """What the converter makes of counts that need not be whole: the saturated count where they are too large."""
    whole = np.rint(counts)
    return np.where(np.abs(whole) > chip.largest_count, chip.saturated_count, whole).astype(np.int16)
