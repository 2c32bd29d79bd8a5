"""One chip's sample that comes before the frame that holds it, to save the wait for the frame (wire.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.sensor.chips import DEFAULT_CHIP, Chip


@dataclass(frozen=True, slots=True)
class EarlySample:
    """counts: x, y, z in the sensor's axes, as in a `Frame`. device_time_us: the source's clock at the conversion."""

    pad_index: int
    sensor: int
    device_time_us: int
    gain_code: int
    counts: tuple[int, int, int]
    chip: Chip = DEFAULT_CHIP

    @property
    def is_possible(self) -> bool:
        """Whether a source can have given these numbers. The pipeline checks the sensor's number."""
        counts_fit = all(-(1 << 15) <= count < 1 << 15 for count in self.counts)
        return self.sensor >= 0 and self.gain_code in range(8) and self.device_time_us >= 0 and counts_fit

    @property
    def field_t(self) -> NDArray[np.float64]:
        """(3,) field in tesla, in the sensor's own axes, NaN where an axis holds no measurement."""
        counts, largest = np.array(self.counts), self.chip.largest_count
        measured = (counts != self.chip.saturated_count) & (counts <= largest) & (counts >= -largest - 1)
        field: NDArray[np.float64] = np.where(measured, counts * self.chip.step_t[self.gain_code], np.nan)
        return field
