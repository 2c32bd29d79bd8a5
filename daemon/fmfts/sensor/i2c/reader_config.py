"""The configuration of the reader process of one I2C bus, and whether the bus can carry its sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msgspec import Struct

from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.rates import BusLoad, i2c_cycle_s, i2c_rate_hz
from fmfts.sensor.source import SourceError
from fmfts.sensor.wire.packets import MAX_PADS, MAX_SENSORS, MOST_DESCRIBED
from fmfts.sensor.wired_pad import PadOnI2c, Settings


class PadWiring(Struct, frozen=True):
    """mux_addresses, channels: of each sensor; empty where the chips are straight on the bus."""

    name: str
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
    def sensors(self) -> int:
        return sum(len(pad.addresses) for pad in self.pads)

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
    """The reader's configuration for the pads of one bus, by pad index; SourceError if they cannot work together."""
    in_order = [pads[index] for index in sorted(pads)]
    first = in_order[0]
    settings = Settings.of(first)
    wirings = tuple(PadWiring(pad.name, pad.mux_addresses, pad.channels, pad.addresses) for pad in in_order)
    for pad in in_order:
        _check_channels(pad)
    _check_sharing(wirings)
    config = ReaderConfig(
        first.bus, first.clock_hz, first.chip.name, first.rate_hz, settings.gain_code, settings.trigger, wirings
    )
    if config.rate_hz > config.highest_rate_hz:
        names = " and ".join(repr(pad.name) for pad in in_order)
        raise SourceError(
            f"pad {names}: {config.sensors} sensors at {config.rate_hz} Hz are more "
            f"than I2C bus {first.bus} carries at {first.clock_hz} Hz: at most {config.highest_rate_hz} Hz; "
            "lower rate_hz, raise clock_hz (400000 is the mux's limit), or use another bus"
        )
    return config


def _check_channels(pad: PadOnI2c) -> None:
    """Every sensor can be reached, each by its own path."""
    channels, addresses = pad.channels, pad.addresses
    muxes = pad.mux_addresses
    if len(muxes) != len(channels):
        raise SourceError(
            f"pad {pad.name!r}: {len(muxes)} mux_addresses, but {len(channels)} channels: one mux and one channel a "
            "sensor, or neither"
        )
    if (channels and len(channels) != pad.sensors) or not 1 <= pad.sensors <= MAX_SENSORS:
        raise SourceError(
            f"pad {pad.name!r}: {len(channels)} channels, but {pad.sensors} places in geometry.sensors_mm: "
            f"one channel a sensor, 1 to {MAX_SENSORS} of them"
        )
    if len(addresses) != pad.sensors:
        where = ", ".join(f"0x{each:02x}" for each in pad.chip.addresses)
        raise SourceError(
            f"pad {pad.name!r}: {len(addresses)} addresses, but {pad.sensors} places in geometry.sensors_mm: an "
            f"{pad.chip.label} can be at {where}; more of them need a mux"
        )
    if len(set(ways(pad))) != pad.sensors:
        what = "channels" if channels else "addresses"
        own = "a channel of its own" if channels else "an address of its own"
        values = list(channels) if channels else [f"0x{each:02x}" for each in addresses]
        raise SourceError(f"pad {pad.name!r}: {what} = {values}: every sensor needs {own}")


def ways(pad: PadOnI2c | PadWiring) -> list[tuple[int | None, int | None, int]]:
    """Mux, channel and address of each sensor."""
    none = (None,) * len(pad.addresses)
    return list(zip(pad.mux_addresses or none, pad.channels or none, pad.addresses, strict=True))


def _check_sharing(wirings: Sequence[PadWiring]) -> None:
    if len(wirings) > MAX_PADS:
        raise SourceError(f"{len(wirings)} pads on one I2C bus ({_names(wirings)}): at most {MAX_PADS}")
    sensors = sum(len(pad.addresses) for pad in wirings)
    if sensors > MOST_DESCRIBED:
        raise SourceError(f"{sensors} sensors on one I2C bus ({_names(wirings)}): at most {MOST_DESCRIBED}")
    direct = {address: pad.name for pad in wirings if not pad.channels for address in pad.addresses}
    for index, pad in enumerate(wirings):
        for other in wirings[:index]:
            theirs = set(ways(other))
            for mux, channel, address in (way for way in ways(pad) if way in theirs):
                where = f"address 0x{address:02x}" if mux is None else f"channel {channel} of mux 0x{mux:02x}"
                raise SourceError(f"pads {other.name!r} and {pad.name!r} both use {where}")
        hidden = set(pad.addresses) & set(direct) if pad.channels else set()
        if hidden:
            address = min(hidden)
            raise SourceError(
                f"pads {direct[address]!r} and {pad.name!r} both have a chip at 0x{address:02x}, one of them straight "
                "on the bus: it would answer for the one behind the mux; give it another address, or the other a bus"
            )


def _names(wirings: Sequence[PadWiring]) -> str:
    return ", ".join(wiring.name for wiring in wirings)
