"""Errors in the configuration of pads on an I2C bus: paths to the chips, and the load of the bus."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fmfts.config import I2cSource, PadConfig
from fmfts.config.section import Problem
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.rates import BusLoad, i2c_rate_hz
from fmfts.sensor.wire.packets import MAX_PADS, MOST_DESCRIBED

FIRST_MUX = 0x70
MUX_CLOCK_HZ = 400_000  # SCPS207, f_scl
CLOCKS = {100_000: "100 kHz", 400_000: "400 kHz", 1_000_000: "1 MHz"}
WHERE_MUXES_ARE = "a TCA9548A is at 0x70 to 0x77 (112 to 119), as its pins A0 to A2 say"


def of_pad(source: I2cSource, sensors: int) -> Iterator[Problem]:
    """Keys of [pad.source] in a pad with so many sensors."""
    chip = CHIPS[source.chip]
    yield from _muxes(source, sensors)
    if source.channels and source.clock_hz > MUX_CLOCK_HZ:
        yield ("source", "clock_hz"), f"at most {MUX_CLOCK_HZ} with a TCA9548A; more only without a mux"
    if source.channels and len(source.channels) != sensors:
        yield ("source", "channels"), f"one channel for each of the {sensors} sensors in geometry.sensors_mm"
        return
    addresses = source.sensor_addresses(sensors)
    where = ", ".join(f"0x{each:02x}" for each in chip.addresses)
    foreign = [each for each in addresses if each not in chip.addresses]
    if len(addresses) != sensors and not source.addresses:
        yield (
            ("source", "channels"),
            f"without a mux at most {len(chip.addresses)} chips fit on a bus: {chip.named} can be at {where}; name "
            "the channels of a mux",
        )
    elif len(addresses) != sensors:
        yield ("source", "addresses"), f"one address for each of the {sensors} sensors in geometry.sensors_mm"
    elif foreign:
        yield ("source", "addresses"), f"{chip.named} can be at {where}, not at 0x{foreign[0]:02x}"
    elif source.channels:
        yield from _ways(source, addresses)
    elif len(set(addresses)) != sensors:
        yield ("source", "addresses"), "each sensor needs an address of its own"


def _muxes(source: I2cSource, sensors: int) -> Iterator[Problem]:
    if not source.mux_addresses:
        if source.channels and not _is_mux(source.mux_address):
            yield ("source", "mux_address"), WHERE_MUXES_ARE
        return
    if not source.channels:
        yield ("source", "mux_addresses"), "without a mux leave it out; with muxes, channels says where each sensor is"
    elif len(source.mux_addresses) != sensors:
        yield ("source", "mux_addresses"), f"one mux for each of the {sensors} sensors in geometry.sensors_mm"
    for number, address in enumerate(source.mux_addresses):
        if not _is_mux(address):
            yield ("source", "mux_addresses", number), WHERE_MUXES_ARE


def _is_mux(address: int) -> bool:
    return FIRST_MUX <= address <= FIRST_MUX + 7


def _ways(source: I2cSource, addresses: Sequence[int]) -> Iterator[Problem]:
    """Two sensors that are in one place."""
    first: dict[tuple[int, int, int], int] = {}
    for number, way in enumerate(zip(source.sensor_muxes, source.channels, addresses, strict=False)):
        before = first.setdefault(way, number)
        if before != number:
            mux, channel, address = way
            yield (
                ("source", "channels"),
                f"each sensor needs a channel of its own: sensors {before + 1} and {number + 1} are both at "
                f"0x{address:02x} on channel {channel} of mux 0x{mux:02x}; a second mux goes into mux_addresses",
            )
            return


def rates_carried(pads: Sequence[PadConfig], source: I2cSource) -> str:
    """The rate of the bus of one of these pads at usual clocks, with all pads on it."""
    load = BusLoad.of(
        (len(pad.geometry.sensors_mm), pad.source.sensor_muxes)
        for pad in pads
        if isinstance(pad.source, I2cSource) and pad.source.bus == source.bus
    )
    rates = (
        f"{i2c_rate_hz(CHIPS[source.chip], source.trigger, clock_hz, load)} Hz ({clock})"
        for clock_hz, clock in CLOCKS.items()
        if clock_hz <= MUX_CLOCK_HZ or not load.muxed
    )
    sensors = "1 sensor" if load.sensors == 1 else f"{load.sensors} sensors"
    return f"I2C bus {source.bus} carries {sensors} at up to {', '.join(rates)}"


def of_buses(pads: Sequence[PadConfig]) -> Iterator[Problem]:
    """The total load of the pads on a bus."""
    on: dict[int, list[tuple[int, Sequence[int]]]] = {}  # bus → sensors of each pad, and the mux of each sensor
    clock_hz: dict[int, int] = {}
    too_fast: dict[int, Problem] = {}  # of a bus, for the last pad: its sentence has all pads
    names: dict[int, list[str]] = {}
    for number, pad in enumerate(pads):
        source = pad.source
        if not isinstance(source, I2cSource):
            continue
        if clock_hz.setdefault(source.bus, source.clock_hz) != source.clock_hz:
            yield ("pad", number, "source", "clock_hz"), f"bus {source.bus} has one clock: {clock_hz[source.bus]}"
        if len(names.setdefault(source.bus, [])) == MAX_PADS:
            before = ", ".join(names[source.bus])
            yield ("pad", number, "source", "bus"), f"at most {MAX_PADS} pads on one bus: {before} are there already"
        there = on.setdefault(source.bus, [])
        there.append((len(pad.geometry.sensors_mm), source.sensor_muxes))
        names[source.bus].append(pad.name)
        load = BusLoad.of(there)
        if load.sensors > MOST_DESCRIBED:
            yield (
                ("pad", number, "geometry", "sensors_mm"),
                f"bus {source.bus} then has {load.sensors} sensors: at most {MOST_DESCRIBED} on one bus",
            )
        most_hz = i2c_rate_hz(CHIPS[source.chip], source.trigger, source.clock_hz, load)
        if source.rate_hz > most_hz:
            too_fast[source.bus] = (
                ("pad", number, "source", "rate_hz"),
                _more_than_carried(source, most_hz, load, names[source.bus]),
            )
    yield from too_fast.values()
    yield from _hidden(pads)


def _hidden(pads: Sequence[PadConfig]) -> Iterator[Problem]:
    """A chip behind a mux at the address of one that is straight on the bus."""
    direct: dict[tuple[int, int], str] = {}  # by bus and address, the pad
    for pad in pads:
        if isinstance(pad.source, I2cSource) and not pad.source.channels:
            addresses = pad.source.sensor_addresses(len(pad.geometry.sensors_mm))
            direct |= {(pad.source.bus, address): pad.name for address in addresses}
    for number, pad in enumerate(pads):
        if isinstance(pad.source, I2cSource) and pad.source.channels:
            for address in dict.fromkeys(pad.source.sensor_addresses(len(pad.geometry.sensors_mm))):
                if (other := direct.get((pad.source.bus, address))) is not None:
                    yield (
                        ("pad", number, "source", "channels"),
                        f"pad {other!r} has a chip at 0x{address:02x} straight on the bus, which would answer for the "
                        "one behind the mux: give one of them another address, or a bus of its own",
                    )


def _more_than_carried(source: I2cSource, most_hz: int, load: BusLoad, names: Sequence[str]) -> str:
    mode = f'trigger = "{source.trigger}" and clock_hz = {source.clock_hz}'
    sentence = f"at most {most_hz}: more than bus {source.bus} can carry, {load.sensors} sensors with {mode}"
    if len(names) == 1:
        return sentence
    all_pads = " and ".join(f"'{name}'" for name in names)
    free_hz = i2c_rate_hz(CHIPS[source.chip], "free", source.clock_hz, load)
    free = f', or trigger = "free" (at most {free_hz} Hz)' if source.trigger != "free" and free_hz > most_hz else ""
    too_much = f"{source.rate_hz} Hz is too much for all its pads"
    return f"{sentence}: {too_much}; set rate_hz = {most_hz} in pads {all_pads}{free}"
