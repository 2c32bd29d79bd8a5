"""Defines the tables and keys of the configuration file; names end in their unit. config.toml explains every key.

`file.load` reads a file; `checks.problems_in` finds errors that the types here do not exclude.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, field
from msgspec.structs import force_setattr

from fmfts.arithmetic.matrix import length, lengths
from fmfts.config.layouts import BoardName, layout
from fmfts.config.model_kinds import ModelKind, kind_of
from fmfts.config.section import DeviationDeg, DeviationMm, Fraction, PositiveFloat, Problem, Vector
from fmfts.config.section import Section as _Section
from fmfts.config.sources import (
    BridgeSource,
    I2cSource,
    Imperfection,
    PadName,
    PluggedSource,
    ReplaySource,
    SimulatedSource,
    SourceConfig,
)
from fmfts.contact.shipped import SHIPPED_PATHS
from fmfts.contact.tolerances import FINGER_M, MODULUS, PROBE_M, THICKNESS_M, StructureTolerance
from fmfts.pad import (
    Array,
    DriftLimits,
    Magnet,
    Pad,
    Placement,
    RestingMagnet,
    SensorArray,
    Silicone,
    Tolerance,
    rotation_from_vector,
)
from fmfts.sensor.chips import CHIPS

__all__ = [
    "STANDARD_SENSORS_MM",
    "BridgeSource",
    "BusConfig",
    "Config",
    "ContactConfig",
    "GeometryConfig",
    "I2cSource",
    "Imperfection",
    "MagnetConfig",
    "PadConfig",
    "PadName",
    "PlacementConfig",
    "PluggedSource",
    "RebaselineConfig",
    "ReplaySource",
    "SceneConfig",
    "ServiceConfig",
    "SiliconeConfig",
    "SimulatedSource",
    "SourceConfig",
    "ToleranceConfig",
    "neighbours_of",
]

STANDARD_SENSORS_MM: tuple[Vector, ...] = ((8, 8, 0), (8, -8, 0), (-8, 8, 0), (-8, -8, 0))
# Magnets in mm: thinner ones are not made (a smaller number is probably in metres), thicker ones fit no fingertip.
MagnetSize = Annotated[float, Meta(ge=0.2, le=50.0)]
# Wider ones exceed the table of presses.
FingerSize = Annotated[float, Meta(ge=0.0, le=30.0)]


class BusConfig(_Section, frozen=True):
    """Where the daemon serves clients."""

    endpoint: str | None = None  # a base as in FMFTS_BUS (fmfts_client.endpoints); None: the default
    keys: str | None = None  # folder of the keys for tcp


class ServiceConfig(_Section, frozen=True):
    """Real-time settings, which the daemon requests from the operating system."""

    # SCHED_FIFO priority; 0: a normal process. None: what the unit gives (service/realtime.py), if permitted.
    realtime_priority: Annotated[int, Meta(ge=0, le=99)] | None = None
    lock_memory: bool = False


class GeometryConfig(_Section, frozen=True):
    """sensors_mm, sensor_rotations_deg: where the file has none, those of `board`."""

    board: BoardName | None = None
    sensors_mm: tuple[Vector, ...] = None  # type: ignore[assignment]
    sensor_rotations_deg: tuple[Vector, ...] = None  # type: ignore[assignment]
    sensors_mirrored: bool = False

    def __post_init__(self) -> None:
        places, rotations = (STANDARD_SENSORS_MM, ()) if self.board is None else layout(self.board)
        if self.sensors_mm is None:
            force_setattr(self, "sensors_mm", places)
        if self.sensor_rotations_deg is None:
            force_setattr(self, "sensor_rotations_deg", rotations)


class MagnetConfig(_Section, frozen=True):
    diameter_mm: MagnetSize = 2.0
    length_mm: MagnetSize = 2.0
    remanence_t: Annotated[float, Meta(ge=0.001, le=2)] = 1.23
    rest_mm: Vector = (0, 0, 12)
    rest_axis: Vector = (0, 0, 1)
    temperature_coefficient_per_k: Annotated[float, Meta(ge=-0.01, le=0.01)] = -0.0012

    def resting(self, sensors_m: Array) -> RestingMagnet:
        """The same facts in SI. sensors_m (N, 3): places of the pad's sensors."""
        axis, rest = np.array(self.rest_axis, dtype=float), np.array(self.rest_mm, dtype=float) * 1e-3
        magnet = Magnet(self.diameter_mm * 1e-3, self.length_mm * 1e-3, self.remanence_t)
        return RestingMagnet(magnet.seen_from(float(lengths(sensors_m - rest).min())), rest, axis / length(axis))


class ToleranceConfig(_Section, frozen=True):
    """Standard deviations of a pad's building errors: the priors of the baseline's estimate, and uncertainties that it
    does not reduce.

    modulus, thickness_mm: None where a file has none: usual ones of a shipped contact model, 0 of one that was
    calibrated on the pad.
    """

    sensor_position_mm: DeviationMm = 0.1
    magnet_position_mm: DeviationMm = 0.1
    magnet_tilt_deg: DeviationDeg = 0.25
    pad_tilt_deg: DeviationDeg = 1.0
    gain: Fraction = 0.05
    remanence: Fraction = 0.1
    sensor_rotation_deg: DeviationDeg = 1.5
    cross_axis: Fraction = 0.005
    modulus: Fraction | None = None
    thickness_mm: DeviationMm | None = None

    def si(self) -> Tolerance:
        """The same facts in SI."""
        return Tolerance(
            sensor_position_m=self.sensor_position_mm * 1e-3,
            magnet_position_m=self.magnet_position_mm * 1e-3,
            magnet_tilt_rad=math.radians(self.magnet_tilt_deg),
            pad_tilt_rad=math.radians(self.pad_tilt_deg),
            gain=self.gain,
            remanence=self.remanence,
            sensor_rotation_rad=math.radians(self.sensor_rotation_deg),
            cross_axis=self.cross_axis,
        )


class SiliconeConfig(_Section, frozen=True):
    """How the pad's silicone differs from a spring, as shares of the magnet's way."""

    creep_per_decade: Fraction = 0.02
    hysteresis: Fraction = 0.01

    def si(self) -> Silicone:
        return Silicone(self.creep_per_decade, self.hysteresis)


class SceneConfig(_Section, frozen=True):
    ambient: Literal["constant", "drifting", "posture"] = "drifting"
    remanence: Literal["measured", "drifting"] = "measured"
    neighbours: tuple[PadName, ...] = ()
    steel_nearby: bool = False

    @property
    def solved(self) -> Literal["constant", "drifting"]:
        """The frame's model of the ambient field: a posture's effect is known, or widens the deviations."""
        return "constant" if self.ambient == "constant" else "drifting"


class PlacementConfig(_Section, frozen=True):
    """The pad's place in a frame that all pads share; needed where pads are neighbours."""

    position_mm: Vector = (0, 0, 0)
    rotation_deg: Vector = (0, 0, 0)
    tolerance_mm: DeviationMm = 0.3

    def si(self) -> Placement:
        """The same facts in SI."""
        rotation = rotation_from_vector(np.deg2rad(np.array(self.rotation_deg, dtype=float)))
        return Placement(np.array(self.position_mm, dtype=float) * 1e-3, rotation, self.tolerance_mm * 1e-3)


Friction = Annotated[float, Meta(ge=0, le=2)]


class ContactConfig(_Section, frozen=True):
    model: str = "default"
    refine: bool = False
    friction: Friction = 0.3
    finger_mm: tuple[FingerSize, FingerSize] = (FINGER_M[0] * 1e3, FINGER_M[1] * 1e3)
    probe_mm: FingerSize | None = None  # of the presses of a model of the user's own; None: not known
    smoothing_ms: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    slip: bool = False
    slip_friction: tuple[Friction, Friction] = (0.2, 1.2)


class RebaselineConfig(_Section, frozen=True):
    """Whether, how fast and how far the baseline follows a slow drift automatically: see docs/drift.md."""

    enabled: bool = False
    quiet_s: Annotated[float, Meta(ge=5.0, le=86400.0)] = 60.0
    rate_um_per_hour: PositiveFloat = 20.0
    limit_um: Annotated[float, Meta(gt=0.0, le=100.0)] = 30.0
    force_below_n: PositiveFloat = 0.1

    def si(self) -> DriftLimits:
        """The same facts in SI."""
        return DriftLimits(
            self.quiet_s, self.rate_um_per_hour * 1e-6 / 3600.0, self.limit_um * 1e-6, self.force_below_n
        )


class PadConfig(_Section, frozen=True, kw_only=True):
    name: PadName
    source: SourceConfig
    geometry: GeometryConfig = field(default_factory=GeometryConfig)
    magnet: MagnetConfig = field(default_factory=MagnetConfig)
    other_magnets: tuple[MagnetConfig, ...] = ()  # the magnets of [[pad.magnet]] after the first
    tolerance: ToleranceConfig = field(default_factory=ToleranceConfig)
    silicone: SiliconeConfig = field(default_factory=SiliconeConfig)
    scene: SceneConfig = field(default_factory=SceneConfig)
    placement: PlacementConfig = field(default_factory=PlacementConfig)
    contact: ContactConfig = field(default_factory=ContactConfig)
    rebaseline: RebaselineConfig = field(default_factory=RebaselineConfig)

    @property
    def model_kind(self) -> ModelKind | None:
        """The kind of a contact model of another package; None: a model of this package."""
        return None if self.other_magnets else kind_of(self.contact.model)

    @property
    def are_magnets_known(self) -> bool:
        """If not, another package's contact model works without their poses."""
        return self.model_kind is None

    def structure_tolerance(self, model: str | None = None) -> StructureTolerance:
        """The uncertainty of a model's contacts through silicone and finger, in SI; None: of the configured one."""
        is_shipped = (self.contact.model if model is None else model) in SHIPPED_PATHS
        usual = (MODULUS, THICKNESS_M * 1e3) if is_shipped else (0.0, 0.0)
        said = (self.tolerance.modulus, self.tolerance.thickness_mm)
        modulus, thickness_mm = (one if one is not None else other for one, other in zip(said, usual, strict=True))
        smallest_mm, largest_mm = self.contact.finger_mm
        finger_m, probe_mm = (smallest_mm * 1e-3, largest_mm * 1e-3), self.contact.probe_mm
        own_probe_m = None if probe_mm is None else probe_mm * 1e-3
        return StructureTolerance(
            modulus, thickness_mm * 1e-3, finger_m, probe_m=PROBE_M if is_shipped else own_probe_m
        )

    def pad(self) -> Pad:
        """The nominal pad, in SI."""
        positions = np.array(self.geometry.sensors_mm, dtype=float) * 1e-3
        sensors = SensorArray.aligned(positions)
        if self.geometry.sensor_rotations_deg:
            vectors = np.deg2rad(np.array(self.geometry.sensor_rotations_deg, dtype=float))
            sensors = SensorArray(positions, np.array([rotation_from_vector(vector) for vector in vectors]))
        if self.geometry.sensors_mirrored:
            sensors = sensors.mirrored()
        first, *others = (one.resting(positions) for one in (self.magnet, *self.other_magnets))
        return Pad(
            name=self.name,
            sensors=sensors,
            magnet=first.magnet,
            rest_position_m=first.rest_position_m,
            rest_axis=first.rest_axis,
            chip=CHIPS[self.source.chip],
            silicone=self.silicone.si(),
            other_magnets=tuple(others),
            are_magnets_known=self.are_magnets_known,
        )


class Config(_Section, frozen=True):
    pad: tuple[PadConfig, ...]
    bus: BusConfig = field(default_factory=BusConfig)
    service: ServiceConfig = field(default_factory=ServiceConfig)
    collect: dict[str, Any] = field(default_factory=dict)  # the package fmfts-collect reads and checks it

    def problems_of_extras(self) -> Iterator[Problem]:
        """Errors in the tables of other packages, beyond their types; a package's own configuration finds them."""
        return iter(())


def neighbours_of(pad: PadConfig, pads: Sequence[PadConfig]) -> list[PadConfig]:
    """The pads of a file that `pad` names as its neighbours."""
    return [other for other in pads if other.name in pad.scene.neighbours]
