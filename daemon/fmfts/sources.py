"""Makes the sources of frames that a configuration's pads need. Imports a driver only where a pad needs it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec

from fmfts.baseline import Baseline, BaselineError
from fmfts.baseline.origin import Origin
from fmfts.common.extras import PartError, added, how_to_install
from fmfts.common.reading import damage_told
from fmfts.config import BridgeSource, I2cSource, PadConfig, PluggedSource, ReplaySource, SimulatedSource, neighbours_of
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.source import LackingError, Source, SourceError
from fmfts.sensor.wired_pad import PadOnBoard, PadOnI2c

RECORDINGS = "fmfts.recordings"  # entry point: the source that plays a recording
SIMULATIONS = "fmfts.simulations"  # entry points: what makes the source of a simulated pad, and its baseline
# Settings that may differ between pads of one device; all others belong to the device and must be equal.
_SETTINGS_OF_A_PAD = {
    BridgeSource: {"pad_index", "publish"},
    I2cSource: {"mux_address", "mux_addresses", "channels", "addresses", "publish"},
    ReplaySource: {"pad", "rate_hz", "range_gauss", "trigger", "chip"},
}


@dataclass(frozen=True, slots=True)
class Device:
    """A source that can be made, again and again. names: of its pads, by their index on it.

    open: SourceError where the source cannot do what is configured. is_file: the content of a file decides that, too.
    """

    names: Mapping[int, str]
    open: Callable[[], Source]
    description: str
    is_file: bool = False


def open_sources(pads: Sequence[PadConfig], around: Sequence[PadConfig] = ()) -> list[tuple[Source, dict[int, str]]]:
    """One source for each device, with the names of its pads by their index on it. Raises as `devices` and `open`."""
    return [(device.open(), dict(device.names)) for device in devices(pads, around)]


def devices(pads: Sequence[PadConfig], around: Sequence[PadConfig] = ()) -> list[Device]:
    """The sources' makers.

    Pads with one serial port share a Bridge, pads with one bus number an I2c, pads of one recording a Replayed. Each
    simulated pad has its own Simulated, which measures the magnets of its neighbours (from `around`, or else `pads`).
    `open` reads a recording, but opens no other device, because that could fail or wait: `poll` opens it. Raises
    SourceError where pads cannot share a device.
    """
    _require_one_port_a_board(pads)
    members: dict[tuple[str, object], list[PadConfig]] = {}
    for pad in pads:
        members.setdefault(_device(pad), []).append(pad)
    return [_device_of(kind, where, shared, around or pads) for (kind, where), shared in members.items()]


def _device(pad: PadConfig) -> tuple[str, object]:
    match pad.source:
        case BridgeSource(port=port):
            return ("bridge", port)
        case I2cSource(bus=bus):
            return ("i2c", bus)
        case ReplaySource(file=file):
            return ("replay", file)
        case SimulatedSource():
            return ("simulated", pad.name)
        case PluggedSource() as plugged:
            return (plugged.type, plugged.device)


def _device_of(kind: str, where: object, members: list[PadConfig], pads: Sequence[PadConfig]) -> Device:
    _require_equal_settings(members)
    by_index = _by_index(members)
    names = {index: pad.name for index, pad in by_index.items()}
    is_file = isinstance(members[0].source, ReplaySource)
    description = f"recording {where}" if is_file else f"{kind} {where}"
    return Device(names, partial(_driver, by_index, pads), description, is_file)


def _driver(by_index: Mapping[int, PadConfig], pads: Sequence[PadConfig]) -> Source:
    first = next(iter(by_index.values()))
    match first.source:
        case BridgeSource():
            from fmfts.sensor.bridge.bridge import Bridge

            return Bridge({index: on_board(pad, pads) for index, pad in by_index.items()})
        case I2cSource():
            from fmfts.sensor.i2c.source import I2c

            return I2c({index: on_i2c(pad) for index, pad in by_index.items()})
        case ReplaySource():
            driver: Callable[..., Source] = _of_another(RECORDINGS, "replay", "replay", "recording")
            return driver(by_index)
        case SimulatedSource():
            driver = simulation("source")
            return driver(first, neighbours_of(first, pads))
        case PluggedSource() as plugged:
            return plugged.driver(by_index)


def simulation(part: str) -> Any:
    """A part of SIMULATIONS. Raises LackingError where their package is not installed."""
    return _of_another(SIMULATIONS, part, "simulated", "simulation")


def _of_another(group: str, name: str, source: str, package: str) -> Any:
    try:
        part = added(group, name)
    except PartError as error:
        raise LackingError(f"the source '{source}': {error}; it {how_to_install(package)}") from error
    if part is None:
        raise LackingError(f"the source '{source}' {how_to_install(package)}")
    return part


def on_board(pad: PadConfig, pads: Sequence[PadConfig] = ()) -> PadOnBoard:
    """The bridge driver's settings from the configuration. pads: all that are configured, or none beside it."""
    source = pad.source
    assert isinstance(source, BridgeSource)
    beside = tuple(
        (other.source.pad_index, len(other.geometry.sensors_mm))
        for other in pads
        if isinstance(other.source, BridgeSource) and _device(other) == _device(pad) and other.name != pad.name
    )
    return PadOnBoard(**chips_of(pad), port=source.port, baud=source.baud, uid=source.uid, beside=beside)


def on_i2c(pad: PadConfig) -> PadOnI2c:
    """The I2C driver's settings from the configuration."""
    source = pad.source
    assert isinstance(source, I2cSource)
    return PadOnI2c(
        **chips_of(pad),
        bus=source.bus,
        clock_hz=source.clock_hz,
        mux_addresses=source.sensor_muxes,
        channels=source.channels,
        addresses=source.sensor_addresses(len(pad.geometry.sensors_mm)),
    )


def origin_of(pad: PadConfig) -> Origin | None:
    """The pad's sensors as far as configured; None: a recording, which has its own baseline."""
    match pad.source:
        case BridgeSource(chip=chip, uid=uid, pad_index=pad_index):
            return Origin("bridge", chip, uid=None if uid is None else uid.lower(), pad_index=pad_index)
        case I2cSource(chip=chip, bus=bus, channels=channels, addresses=addresses):
            if not channels:
                own = pad.source.sensor_addresses(len(pad.geometry.sensors_mm))
                return Origin("i2c", chip, bus=bus, addresses=own)
            muxes = pad.source.sensor_muxes
            one, several = (muxes[0], None) if len(set(muxes)) == 1 else (None, muxes)
            return Origin(
                "i2c",
                chip,
                bus=bus,
                mux_address=one,
                mux_addresses=several,
                channels=channels,
                addresses=addresses or None,
            )
        case SimulatedSource(chip=chip, seed=seed):
            return Origin("simulated", chip, seed=seed)
        case PluggedSource() as plugged:
            return Origin(plugged.type, plugged.chip, port=plugged.device)
        case ReplaySource():
            return None


def recorded_baseline(source: Any, pad_index: int) -> Baseline | None:
    """The baseline in a recording; None where the pad had none. Raises BaselineError where it is of another version."""
    state = source.states[pad_index]
    if state.baseline is None:
        return None
    with damage_told(BaselineError, f"pad '{state.pad}': the baseline in {source.state.description} is damaged"):
        return msgspec.convert(state.baseline, Baseline)


def require_device(pad: PadConfig) -> None:
    """Raise BaselineError where the pad is a recording: a baseline made of old frames must not be stored for it."""
    if isinstance(pad.source, ReplaySource):
        raise BaselineError(f"pad '{pad.name}' is a recording, and its baseline is in it: there is nothing to record")


def chips_of(pad: PadConfig) -> dict[str, Any]:
    """A pad's part of `WiredPad`, for the sources of other packages, too."""
    source = pad.source
    return {
        "name": pad.name,
        "sensors": len(pad.geometry.sensors_mm),
        "chip": CHIPS[source.chip],
        "rate_hz": source.rate_hz,
        "range_gauss": source.range_gauss,
        "trigger": source.trigger,
        "early": source.publish == "sample",
    }


def _by_index(members: list[PadConfig]) -> dict[int, PadConfig]:
    by_index: dict[int, PadConfig] = {}
    for position, pad in enumerate(members):
        index = pad.source.pad_index if isinstance(pad.source, BridgeSource) else position
        if index in by_index:
            raise SourceError(
                f"pads {by_index[index].name!r} and {pad.name!r} are both pad_index = {index} of one board"
            )
        by_index[index] = pad
    return by_index


def _require_equal_settings(members: list[PadConfig]) -> None:
    first = members[0]
    may_differ = _SETTINGS_OF_A_PAD.get(type(first.source), set())
    for other in members[1:]:
        for name in first.source.__struct_fields__:
            value, other_value = getattr(first.source, name), getattr(other.source, name)
            if name not in may_differ and value != other_value:
                names = f"pads {first.name!r} and {other.name!r}"
                raise SourceError(f"{names} share a device but differ in {name}: {value!r} and {other_value!r}")


def _require_one_port_a_board(pads: Sequence[PadConfig]) -> None:
    pad_of_board: dict[str, tuple[str, str]] = {}  # uid → name and port of its first pad
    for pad in pads:
        if isinstance(pad.source, BridgeSource) and pad.source.uid is not None:
            name, port = pad_of_board.setdefault(pad.source.uid.lower(), (pad.name, pad.source.port))
            if port != pad.source.port:
                names = f"pads {name!r} and {pad.name!r}"
                raise SourceError(f"{names} are bound to one board but name two ports: {port} and {pad.source.port}")
