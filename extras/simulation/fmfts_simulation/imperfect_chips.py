"""Simulates errors of real chips besides white noise, each with its size and source.

Figures of the HMC5983's family from Honeywell's data sheets 900425 (HMC5883L/5983) and 900248 (its bridges, HMC1001).
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array
from fmfts.sensor.chips import Chip

# Each sample is the half difference of a set and a reset pulse, which cancels a bridge's offset and its drift (900425,
# "H-Bridge for Set/Reset Strap Drive"). What is left is the chip's `offset_t_per_k`.
# A field beyond the "disturbing field" of 20 G may leave a chip magnetised whose pulses are too weak: assumed, 10 mG.
DISTURBED_T, DISTURBED_AT_S = 1e-6, 10.0
# 1/f noise of a bare bridge equals its white noise at 10 Hz (900248, "Noise characteristics"). Set and reset pulses
# remove most of it (I. Mateos et al., arXiv 1604.08460): 1 Hz is assumed. One random process a decade.
CORNER_HZ = 1.0
DECADES_S = np.array([0.016, 0.16, 1.6, 16.0, 160.0])
# Steps between two values, as of a magnetic domain that jumps: one count of the ±2.5 G range, every 10 s.
STEP_T, STEP_EVERY_S = 1.5e-7, 10.0
# "Linearity": 0.1 % of full scale at ±2 G (900425): a cubic.
NONLINEARITY, LINEAR_RANGE_T = 1e-3, 2e-4
# There is no check sum, so a wrong bit passes. A healthy bus has none; here, one reading in this many.
READINGS_PER_BIT_ERROR = 2000
BITS = 11  # a higher bit makes a count that no chip gives


class ImperfectChips:
    """N chips with some of "offset_drift", "disturbed", "flicker", "steps", "nonlinear" and "bit_errors"."""

    def __init__(self, kinds: Collection[str], sensors: int, chip: Chip, rate_hz: float, random: np.random.Generator):
        self._kinds, self._random, self._chip = kinds, random, chip
        shape = (sensors, 3)
        self.offset_t_per_k = random.normal(0.0, chip.offset_t_per_k, shape)
        self._disturbed_t = np.zeros(shape)
        self._disturbed_t[random.integers(sensors)] = random.normal(0.0, DISTURBED_T, 3)
        self._bend = NONLINEARITY * random.uniform(-1.0, 1.0, shape)
        density_t2_per_hz = chip.noise_t**2 / (rate_hz / 2.0)
        self._flicker_t = float(np.sqrt(density_t2_per_hz * CORNER_HZ * np.log(10.0)))
        self._slow = random.normal(0.0, 1.0, (len(DECADES_S), *shape))
        self._up = random.integers(0, 2, shape).astype(float)
        self._time_s = np.zeros(sensors)

    def reported(self, time_s: Array, field_t: Array, warming_k: float) -> Array:
        """The chips' readings without white noise for `field_t` (K, N, 3) in their axes at their times (K, N)."""
        if "nonlinear" in self._kinds:
            field_t = field_t + self._bend * LINEAR_RANGE_T * (field_t / LINEAR_RANGE_T) ** 3
        if "offset_drift" in self._kinds:
            field_t = field_t + self.offset_t_per_k * warming_k
        if "disturbed" in self._kinds:
            field_t = field_t + self._disturbed_t * (time_s[..., None] > DISTURBED_AT_S)
        if not {"flicker", "steps"} & set(self._kinds):
            return np.asarray(field_t)
        return np.asarray(field_t + np.array([self._wandered_t(moment) for moment in time_s]))

    def _wandered_t(self, time_s: Array) -> Array:
        elapsed_s = np.maximum(time_s - self._time_s, 0.0)[:, None]
        self._time_s = time_s
        error_t = np.zeros(self._up.shape)
        if "flicker" in self._kinds:
            left = np.exp(-elapsed_s / DECADES_S[:, None, None])
            self._slow = left * self._slow + np.sqrt(1.0 - left**2) * self._random.standard_normal(self._slow.shape)
            error_t += self._flicker_t * self._slow.sum(axis=0)
        if "steps" in self._kinds:
            flips = self._random.uniform(size=error_t.shape) < elapsed_s / STEP_EVERY_S
            self._up = np.where(flips, 1.0 - self._up, self._up)
            error_t += STEP_T * (self._up - 0.5)
        return error_t

    def transferred(self, counts: NDArray[np.int16]) -> NDArray[np.int16]:
        """The counts (…, N, 3) after a bus on which a bit may flip."""
        if "bit_errors" not in self._kinds:
            return counts
        wrong = self._random.uniform(size=counts.shape) < 1.0 / READINGS_PER_BIT_ERROR / 3.0
        bit = (1 << self._random.integers(0, BITS, counts.shape)).astype(np.int16)
        return np.where(wrong & (counts != self._chip.saturated_count), counts ^ bit, counts).astype(np.int16)
