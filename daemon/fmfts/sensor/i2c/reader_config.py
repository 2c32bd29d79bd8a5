"""The configuration of the reader process of one I2C bus, and what the bus can carry."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.rates import BusLoad, i2c_cycle_s, i2c_rate_hz
from fmfts.sensor.wired_pad import PadOnI2c, Settings


class PadWiring(Struct, frozen=True):
    """mux_addresses, channels: of each sensor; empty where the chips are straight on the bus."""

    mux_addresses: tuple[int, ...]
    channels: tuple[int, ...]
    addresses: tuple[int, ...]


class ReaderConfig(Struct, frozen=True):
    """`pads` are ordered by pad index."""

    bus: int
    clock_hz: int
    chip: str
    rate_hz: int
    gain_code: int
    trigger: int
    pads: tuple[PadWiring, ...]
    realtime_priority: int = 0  # for SCHED_FIFO; 0: an ordinary process
    lock_memory: bool = False

    @property
    def trigger_name(self) -> str:
        return "simultaneous" if self.trigger else "free"

    @property
    def load(self) -> BusLoad:
        return BusLoad.of((len(pad.addresses), pad.mux_addresses) for pad in self.pads)

    @property
    def cycle_s(self) -> float:
        """Time on the wires for one reading of all sensors."""
        return i2c_cycle_s(CHIPS[self.chip], self.clock_hz, self.load, self.trigger_name)

    @property
    def highest_rate_hz(self) -> int:
        return i2c_rate_hz(CHIPS[self.chip], self.trigger_name, self.clock_hz, self.load)


def reader_config(pads: Mapping[int, PadOnI2c]) -> ReaderConfig:
    """The reader's configuration for the pads of one bus, by pad index; config/i2c_checks.py has checked them."""
    in_order = [pads[index] for index in sorted(pads)]
    first = in_order[0]
    settings = Settings.of(first)
    wirings = tuple(PadWiring(pad.mux_addresses, pad.channels, pad.addresses) for pad in in_order)
    return ReaderConfig(
        first.bus, first.clock_hz, first.chip.name, first.rate_hz, settings.gain_code, settings.trigger, wirings
    )


def ways(pad: PadOnI2c | PadWiring) -> list[tuple[int | None, int | None, int]]:
    """Mux, channel and address of each sensor."""
    none = (None,) * len(pad.addresses)
    return list(zip(pad.mux_addresses or none, pad.channels or none, pad.addresses, strict=True))
