"""One chip on an I2C bus: its state, its last sample, and whether the bytes just read are a new sample."""

from __future__ import annotations

import time
from dataclasses import dataclass

from fmfts.sensor.chips import hmc5983
from fmfts.sensor.chips.chip import Axes
from fmfts.sensor.wire.packets import TEMPERATURE_UNKNOWN, SensorState

RETRY_US = 250_000


def now_us() -> int:
    return time.monotonic_ns() // 1000


@dataclass(slots=True)
class Sensor:
    """`sampled_us`: time of the last sample, None if none is usable. `block`: the data registers as last read."""

    channel: int
    state: SensorState = SensorState.NOT_STARTED
    identification: bytes = bytes(3)
    axes: Axes = (0, 0, 0)
    block: bytes = b""
    sampled_us: int | None = None
    polled_us: int = 0
    started_us: int = 0
    retry_us: int = 0
    fresh: bool = False
    discard: int = 0
    misses: int = 0
    temperature_raw: int = TEMPERATURE_UNKNOWN

    def begin(self, block: bytes) -> None:
        """The sensor is set up. `block` was converted before, so it does not count as a new sample."""
        self.state, self.sampled_us, self.fresh = SensorState.OK, None, False
        self.block = block
        self.discard = 1  # the first sample after a change of gain still has the old gain
        self.polled_us = self.started_us = now_us()

    def lose(self, state: SensorState) -> None:
        self.state = state
        self.retry_us = now_us() + RETRY_US

    def is_new(self, status: int, block: bytes, period_us: int) -> bool:
        """RDY alone does not decide: data may change after RDY was read, and some chips keep RDY set after reading."""
        if block != self.block:
            return True
        age_us = self.polled_us - (self.sampled_us or 0)
        return bool(status & hmc5983.STATUS_READY) and age_us > 0.5 * period_us

    def is_silent(self, period_us: int) -> bool:
        return now_us() - max(self.sampled_us or 0, self.started_us) > 5 * period_us + 100_000

    def take(self, block: bytes, sampled_us: int) -> None:
        self.block = block
        if self.discard:
            self.discard -= 1
            self.started_us = self.polled_us
            return
        self.axes, self.sampled_us, self.fresh = hmc5983.axes_from_registers(block), sampled_us, True
