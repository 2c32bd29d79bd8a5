"""Defines [pad.source] of the configuration file: one table for each type, also of those that other packages add."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Union

from msgspec import Meta
from msgspec.structs import force_setattr

from fmfts.common.extras import PartError, entry_points_of, how_to_install, loaded
from fmfts.config.section import Problem
from fmfts.config.section import Section as _Section
from fmfts.sensor.chips import CHIPS, ChipName
from fmfts.sensor.chips.rates import usual_rate_hz
from fmfts.sensor.source import Source
from fmfts.sensor.wire.packets import MAX_PADS

if TYPE_CHECKING:
    from fmfts.config import PadConfig

log = logging.getLogger(__name__)

SOURCES = "fmfts.sources"  # entry points: subclasses of PluggedSource, by their type
OF_TYPE = {"anyskin": "skin"}  # the extra that reads such a source, where no package here does
FASTEST_HZ = max(chip.free_rate_hz for chip in CHIPS.values())
BoardUid = Annotated[str, Meta(pattern=r"^[0-9A-Fa-f]{24}\Z")]
PadName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}\Z")]


class HardwareSource(_Section, frozen=True):
    """rate_hz, range_gauss: where the file has none, those that suit the chip."""

    rate_hz: Annotated[int, Meta(ge=1, le=FASTEST_HZ)] = None  # type: ignore[assignment]
    range_gauss: float = None  # type: ignore[assignment]
    trigger: Literal["free", "simultaneous"] = "free"
    publish: Literal["frame", "sample"] = "frame"  # "sample": also each sample that comes before its frame
    chip: ChipName = "hmc5983"

    @property
    def serial_port(self) -> str | None:
        """The port of this computer that it opens; None: none."""
        return None

    def __post_init__(self) -> None:
        chip = CHIPS[self.chip]
        if self.rate_hz is None:
            rate_hz = usual_rate_hz(chip, self.trigger, over_bridge=isinstance(self, BridgeSource))
            force_setattr(self, "rate_hz", rate_hz)
        if self.range_gauss is None:
            force_setattr(self, "range_gauss", chip.usual_range_gauss)


class BridgeSource(HardwareSource, frozen=True, tag="bridge", tag_field="type", kw_only=True):
    port: str
    uid: BoardUid | None = None  # accepts only this board, whatever the port's name is
    pad_index: Annotated[int, Meta(ge=0, lt=MAX_PADS)] = 0
    baud: Annotated[int, Meta(ge=9600)] = 460800

    @property
    def serial_port(self) -> str:
        return self.port


class I2cSource(HardwareSource, frozen=True, tag="i2c", tag_field="type", kw_only=True):
    bus: Annotated[int, Meta(ge=0)]
    mux_address: int = 0x70
    mux_addresses: tuple[int, ...] = ()  # address of each sensor's mux; empty: all are mux_address
    channels: tuple[Annotated[int, Meta(ge=0, le=7)], ...] = (0, 1, 2, 3)  # empty: without a mux
    addresses: tuple[Annotated[int, Meta(ge=0x08, le=0x77)], ...] = ()  # empty: where such chips are first
    clock_hz: Annotated[int, Meta(ge=10_000, le=1_000_000)] = 400_000

    @property
    def sensor_muxes(self) -> tuple[int, ...]:
        """The address of each sensor's mux; empty without a mux."""
        return (self.mux_addresses or (self.mux_address,) * len(self.channels)) if self.channels else ()

    def sensor_addresses(self, sensors: int) -> tuple[int, ...]:
        """The address of each of the pad's chips; fewer than `sensors` where these chips have not as many."""
        chip = CHIPS[self.chip]
        return self.addresses or ((chip.address,) * sensors if self.channels else chip.addresses[:sensors])


Imperfection = Literal[
    "silicone", "casting", "soft_iron", "offset_drift", "disturbed", "flicker", "steps", "nonlinear", "bit_errors"
]


class SimulatedSource(HardwareSource, frozen=True, tag="simulated", tag_field="type", kw_only=True):
    seed: Annotated[int, Meta(ge=0)] = 1
    finger: Literal["script", "none"] = "script"
    fingers: Literal[1, 2] = 1  # 2: of a pad with several magnets
    finger_friction: Annotated[float, Meta(ge=0, le=0.5)] = 0.0
    finger_shape: Literal["round", "ball", "edge", "flat", "angled", "thimble"] = "round"
    imperfections: tuple[Imperfection, ...] = ()
    warming_k_per_minute: Annotated[float, Meta(ge=-60, le=60)] = 0.0
    turning_deg_per_s: Annotated[float, Meta(ge=-3600, le=3600)] = 20.0
    mechanics: str = "standard"
    frames_from: str | None = None


class ReplaySource(HardwareSource, frozen=True, tag="replay", tag_field="type", kw_only=True):
    file: str
    pad: PadName | None = None  # the pad's name in the recording; None: the same as here
    loop: bool = False
    speed: Annotated[float, Meta(ge=0.1, le=10.0)] = 1.0


class PluggedSource(HardwareSource, frozen=True, kw_only=True):
    """A device that another package reads. Its subclass has `tag`, which is the file's `type`, and tag_field="type".

    key: the name of the key that distinguishes devices.
    """

    key: ClassVar[str] = "port"

    @property
    def type(self) -> str:
        return str(self.__struct_config__.tag)

    @property
    def device(self) -> str:
        """The identity of the device, also in words for people."""
        return str(getattr(self, self.key))

    def problems(self) -> Iterator[Problem]:
        """Errors in this table beyond its types; the keys begin in the pad."""
        return iter(())

    def driver(self, pads: Mapping[int, PadConfig]) -> Source:
        """Makes the source of pads that share this device, by their index on it. It opens nothing yet."""
        raise NotImplementedError


def lacking_source(kind: Any) -> str | None:
    """The package to install for a source of this type, as the end of a sentence; None: nothing."""
    extra = None if str(kind) in PLUGGED else OF_TYPE.get(str(kind))
    return None if extra is None else how_to_install(extra)


def _plugged() -> dict[str, type[PluggedSource]]:
    """The sources of other packages, by their type. One that cannot be loaded stops no pad of another type.

    A package that is loaded here must import fmfts.config first, because importing it may cause this call.
    """
    found = {}
    for point in entry_points_of(SOURCES):
        try:
            found[point.name] = loaded(point)
        except PartError as error:
            log.warning("[pad.source] type %r is left out: %s", point.name, error)
    return found


PLUGGED = _plugged()

if TYPE_CHECKING:
    SourceConfig = BridgeSource | I2cSource | SimulatedSource | ReplaySource | PluggedSource
else:
    SourceConfig = Union[(BridgeSource, I2cSource, SimulatedSource, ReplaySource, *PLUGGED.values())]
