"""One chip on an I2C bus: its state, its last sample, and whether the bytes just read are a new sample."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache

from fmfts.sensor.chips.chip import Axes, Chip
from fmfts.sensor.i2c.bus import ChipWires
from fmfts.sensor.wire.packets import TEMPERATURE_UNKNOWN, SensorState
from fmfts.sensor.wired_pad import Settings

RETRY_US = 250_000


def now_us() -> int:
    return time.monotonic_ns() // 1000


@dataclass(slots=True)
class Sensor:
    """`sampled_us`: time of the last sample, None if none is usable. `block`: the data registers as last read."""

    wires: ChipWires
    mux_address: int | None  # None: straight on the bus
    channel: int | None  # of the mux
    state: SensorState = SensorState.NOT_STARTED
    identification: bytes = bytes(3)
    axes: Axes = (0, 0, 0)
    block: bytes = b""
    sampled_us: int | None = None
    polled_us: int = 0
    started_us: int = 0  # time of the set-up, or of its last discarded sample
    started_measuring_us: int = 0  # its last triggered measurement; 0: the trigger failed
    late: int = 0  # measurements in a row that had not ended when they were read
    exposure: int = 0  # exposure of its film to strong fields since the last pulse
    magnetised_us: int = 0
    retry_us: int = 0
    fresh: bool = False  # sample not in a frame yet
    unsent: bool = False  # nor sent early
    discard: int = 0
    misses: int = 0
    temperature_raw: int = TEMPERATURE_UNKNOWN
    other: bytes | None = None  # identification of another chip at its address
    look_us: int = 0

    def begin(self, block: bytes | None, stale_samples: int) -> None:
        """The sensor is set up. `block` was converted before, so it does not count as a new sample."""
        self.state, self.sampled_us, self.fresh = SensorState.OK, None, False
        self.block, self.other = block or b"", None
        self.discard = stale_samples
        self.late, self.exposure, self.magnetised_us = 0, 0, now_us()
        self.polled_us = self.started_us = now_us()

    def lose(self, state: SensorState) -> None:
        self.state = state
        self.retry_us = now_us() + RETRY_US

    def is_new(self, ready: bool, block: bytes, period_us: int) -> bool:
        """RDY alone does not decide: data may change after RDY was read, and some chips keep RDY set after reading."""
        if block != self.block:
            return True
        age_us = self.polled_us - (self.sampled_us or 0)
        return ready and age_us > 0.5 * period_us

    def is_silent(self, period_us: int) -> bool:
        return now_us() - max(self.sampled_us or 0, self.started_us) > 5 * period_us + 100_000

    def take(self, block: bytes, axes: Axes, sampled_us: int) -> None:
        """A new sample. `axes` are the counts in `block`."""
        self.block = block
        if self.discard:
            self.discard -= 1
            self.started_us = self.polled_us
            return
        self.axes, self.sampled_us, self.fresh, self.unsent = axes, sampled_us, True, True


@lru_cache(maxsize=16)
def period_us_of(chip: Chip, settings: Settings) -> int:
    """Needed at every reading of every sensor."""
    return round(1e6 / (settings.rate_hz if settings.trigger else chip.output_rate_hz(settings.rate_hz)))
