"""The configuration of the reader process of one I2C bus, and whether the bus can carry its sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from msgspec import Struct

from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.rates import i2c_cycle_s, i2c_rate_hz
from fmfts.sensor.source import SourceError
from fmfts.sensor.wire.packets import MAX_PADS, MAX_SENSORS
from fmfts.sensor.wired_pad import PadOnI2c, Settings


class PadWiring(Struct, frozen=True):
    name: str
    mux_address: int
    channels: tuple[int, ...]


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
        return sum(len(pad.channels) for pad in self.pads)

    @property
    def cycle_s(self) -> float:
        """Time on the wires for one reading of all sensors."""
        return i2c_cycle_s(self.clock_hz, self.sensors, len(self.pads), self.trigger_name)

    @property
    def highest_rate_hz(self) -> int:
        return i2c_rate_hz(CHIPS[self.chip], self.trigger_name, self.clock_hz, self.sensors, len(self.pads))


def reader_config(pads: Mapping[int, PadOnI2c]) -> ReaderConfig:
    """The reader's configuration for the pads of one bus, by pad index; SourceError if they cannot work together."""
    in_order = [pads[index] for index in sorted(pads)]
    first = in_order[0]
    settings = Settings.of(first)
    wirings = tuple(PadWiring(pad.name, pad.mux_address, pad.channels) for pad in in_order)
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
    channels = pad.channels
    if len(channels) != pad.sensors or not 1 <= pad.sensors <= MAX_SENSORS:
        raise SourceError(
            f"pad {pad.name!r}: {len(channels)} channels, but {pad.sensors} places in geometry.sensors_mm: "
            f"one channel a sensor, 1 to {MAX_SENSORS} of them"
        )
    if len(set(channels)) != len(channels):
        raise SourceError(f"pad {pad.name!r}: channels = {list(channels)}: every sensor needs a channel of its own")


def _check_sharing(wirings: Sequence[PadWiring]) -> None:
    if len(wirings) > MAX_PADS:
        raise SourceError(f"{len(wirings)} pads on one I2C bus ({_names(wirings)}): at most {MAX_PADS}")
    for index, pad in enumerate(wirings):
        for other in wirings[:index]:
            shared = set(pad.channels) & set(other.channels)
            if pad.mux_address == other.mux_address and shared:
                raise SourceError(
                    f"pads {other.name!r} and {pad.name!r} "
                    f"both use channel {min(shared)} of mux 0x{pad.mux_address:02x}"
                )


def _names(wirings: Sequence[PadWiring]) -> str:
    return ", ".join(wiring.name for wiring in wirings)
