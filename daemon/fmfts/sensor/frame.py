"""One reading of one pad: the only thing that leaves this stage, whatever the source was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.sensor.hmc5983 import LSB_PER_GAUSS, OVERFLOW_COUNT

TESLA_PER_GAUSS = 1e-4
AGE_UNKNOWN_US = 65535


def step_t(gain_code: int) -> float:
    """The field of one count, in tesla."""
    return TESLA_PER_GAUSS / LSB_PER_GAUSS[gain_code]


@dataclass(frozen=True, slots=True)
class Frame:
    """Raw counts of N sensors with all that is needed to read them.

    counts: (N, 3) int16, order x, y, z in the sensor's axes; OVERFLOW_COUNT marks a saturated axis.
    age_us: (N,) how much older than `device_time_us` each sample is (free chips differ); AGE_UNKNOWN_US at most.
    fresh: (N,) bool, this sample was not in an earlier frame. valid: (N,) bool, this sample may be used.
    device_time_us: the source's own clock at the newest conversion, 64 bit, never wraps.
    host_time_ns: the same instant on the host's CLOCK_MONOTONIC.
    temperature_c: None where the source has no thermometer.
    """

    pad_index: int
    sequence: int
    device_time_us: int
    host_time_ns: int
    gain_code: int
    counts: NDArray[np.int16]
    age_us: NDArray[np.uint16]
    fresh: NDArray[np.bool_]
    valid: NDArray[np.bool_]
    temperature_c: float | None

    @property
    def overflow(self) -> NDArray[np.bool_]:
        """(N, 3) axes that the chip reports as saturated (data sheet: −4096)."""
        overflow: NDArray[np.bool_] = self.counts == OVERFLOW_COUNT
        return overflow

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(N, 3) axes that hold a measurement."""
        usable: NDArray[np.bool_] = self.valid[:, None] & ~self.overflow
        return usable

    @property
    def field_t(self) -> NDArray[np.float64]:
        """(N, 3) field in tesla, in each sensor's own axes, NaN where an axis holds no measurement."""
        field: NDArray[np.float64] = self.counts.astype(np.float64) * step_t(self.gain_code)
        field[~self.usable] = np.nan
        return field
