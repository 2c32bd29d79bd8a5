"""Checks a configuration beyond its types: rates of chips and buses, geometry, names, and sensors read twice."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations
from pathlib import Path

from fmfts.config import (
    BridgeSource,
    Config,
    I2cSource,
    MagnetConfig,
    PadConfig,
    PluggedSource,
    ReplaySource,
    SimulatedSource,
    board_checks,
    i2c_checks,
)
from fmfts.config.layouts import layout
from fmfts.config.model_kinds import lacking
from fmfts.config.neighbour_checks import of_neighbours, of_shared_sensors
from fmfts.config.section import Key, Problem
from fmfts.config.several_checks import several_problems
from fmfts.config.wording import IN_METRES
from fmfts.contact.no_model import NO_MODEL
from fmfts.contact.shipped import SHIPPED_PATHS
from fmfts.contact.tolerances import PROBE_M
from fmfts.sensor.chips import CHIPS
from fmfts.sensor.chips.rates import highest_rate_hz, no_trigger
from fmfts.sensor.wire.packets import MAX_SENSORS
from fmfts_client.endpoints import EndpointError, Endpoints
from fmfts_client.keys import is_loopback

FEWEST_SENSORS = 3
CLOSEST_MM = 2.0  # a nearer magnet would touch the chip
FARTHEST_MM = 100.0  # the field there is 12 mG, six times the noise: a larger number was meant in another unit
SENSOR_SPACING_MM = 1.0


def problems_in(config: Config) -> list[Problem]:
    """All problems of `config`. What pads share is looked at only if each pad alone is good."""
    problems = [*_of_the_bus(config), *_of_the_keys(config), *_of_the_joints(config), *_of_pads(config)]
    problems += config.problems_of_extras()
    problems += _names(config.pad)
    if not problems:
        for check in (of_neighbours, of_shared_sensors, i2c_checks.of_buses, board_checks.of_boards):
            problems += check(config.pad)
    return problems


def _of_the_bus(config: Config) -> Iterator[Problem]:
    base = config.bus.endpoint
    if base is not None:
        try:
            Endpoints.from_base(base)
        except EndpointError as error:
            yield ("bus", "endpoint"), str(error)
        if base.startswith("tcp://") and config.bus.keys is None and not is_loopback(base):
            yield ("bus", "endpoint"), "other machines are let in with keys alone: set bus.keys (docs/security.md)"


def _of_the_joints(config: Config) -> Iterator[Problem]:
    base = config.bus.endpoint or ""
    if not base.startswith("tcp://") or config.bus.keys is not None:
        return
    for number, pad in enumerate(config.pad):
        if pad.scene.ambient == "posture":
            text = "joint positions over tcp need keys, as any user of this machine could send others: set bus.keys, or"
            yield ("pad", number, "scene", "ambient"), f"{text} an endpoint that begins with ipc://"


def _of_the_keys(config: Config) -> Iterator[Problem]:
    if "\0" in (config.bus.keys or ""):
        yield ("bus", "keys"), "must be the name of a folder, which holds no zero byte"


def _of_pads(config: Config) -> Iterator[Problem]:
    if not config.pad:
        yield ("pad",), "at least one [[pad]] is needed"
    for number, pad in enumerate(config.pad):
        checks: tuple[Callable[[PadConfig], Iterator[Problem]], ...] = (
            _source,
            _sensors,
            _rest,
            _model,
            _finger,
            _posture,
            several_problems,
            _kind_of_model,
            _slip,
        )
        for check in checks:
            for keys, text in check(pad):
                yield ("pad", number, *keys), text


def _posture(pad: PadConfig) -> Iterator[Problem]:
    if pad.scene.ambient != "posture":
        return
    if pad.rebaseline.enabled:
        yield ("rebaseline", "enabled"), 'with scene.ambient = "posture" no drift is followed: set it to false'
    if pad.source.publish == "sample":
        yield ("source", "publish"), 'with scene.ambient = "posture" nothing is published between frames: set "frame"'


def _source(pad: PadConfig) -> Iterator[Problem]:
    source, chip = pad.source, CHIPS[pad.source.chip]
    try:
        chip.gain_code_for_range(source.range_gauss)
    except ValueError as error:
        yield ("source", "range_gauss"), str(error)
    most_hz = highest_rate_hz(chip, source.trigger, over_bridge=isinstance(source, BridgeSource))
    if isinstance(source, BridgeSource) and not chip.on_boards:
        yield ("source", "chip"), f"no firmware of a board reads {chip.named}: connect it to an I2C bus"
    if chip.streamed and isinstance(source, BridgeSource | I2cSource):
        yield ("source", "chip"), "a streamed chip belongs to a board that streams its values (docs/anyskin.md)"
    if isinstance(source, PluggedSource):
        yield from source.problems()
    if source.trigger == "simultaneous" and not chip.has_trigger:
        yield ("source", "trigger"), no_trigger(chip)
    elif source.rate_hz > most_hz:
        simultaneous = f'trigger = "simultaneous"{" over a bridge" if isinstance(source, BridgeSource) else ""}'
        mode = simultaneous if source.trigger == "simultaneous" else f'chip = "{source.chip}" running free'
        yield ("source", "rate_hz"), f"at most {most_hz} with {mode}"
    if source.publish == "sample" and not isinstance(source, BridgeSource | I2cSource):
        yield ("source", "publish"), 'only a "bridge" or "i2c" gives samples as they come: set publish = "frame"'
    elif source.publish == "sample" and source.trigger != "free":
        yield (
            ("source", "publish"),
            'chips of one trigger have their samples at once: set trigger = "free", or publish = "frame"',
        )
    if isinstance(source, ReplaySource) and not Path(source.file).is_file():
        yield ("source", "file"), "there is no such recording: `fmfts-daemon record FILE.mcap` makes one"
    if isinstance(source, SimulatedSource) and source.mechanics != "standard" and not Path(source.mechanics).is_file():
        yield ("source", "mechanics"), 'neither "standard" nor a file: `fmfts-daemon pad-model -o PAD.npz` makes one'
    if isinstance(source, I2cSource):
        yield from i2c_checks.of_pad(source, len(pad.geometry.sensors_mm))


def _finger(pad: PadConfig) -> Iterator[Problem]:
    smallest_mm, largest_mm = pad.contact.finger_mm
    if not smallest_mm <= largest_mm:
        yield ("contact", "finger_mm"), f"the smallest width comes first: [{largest_mm:g}, {smallest_mm:g}]"
    if pad.contact.probe_mm not in (None, PROBE_M * 1e3) and pad.contact.model in SHIPPED_PATHS:
        yield ("contact", "probe_mm"), f"the shipped models' probe is {PROBE_M * 1e3:g} mm wide: leave it out"


def _sensors(pad: PadConfig) -> Iterator[Problem]:
    places = pad.geometry.sensors_mm
    board = pad.geometry.board
    if board is not None:
        for key, due in zip(("sensors_mm", "sensor_rotations_deg"), layout(board), strict=True):
            if getattr(pad.geometry, key) != due:
                yield ("geometry", key), f'board = "{board}" says other places and rotations: remove one of the two'
    if len(places) < FEWEST_SENSORS:
        yield (
            ("geometry", "sensors_mm"),
            f"at least {FEWEST_SENSORS} sensors are needed: with two, a diagonal pair is singular at rest "
            "and an adjacent pair is ten times less certain along one axis",
        )
    if isinstance(pad.source, BridgeSource):
        yield from board_checks.of_pad(len(places))
    elif len(places) > MAX_SENSORS:
        yield ("geometry", "sensors_mm"), f"at most {MAX_SENSORS} sensors"
    if len(places) > 1 and max(math.dist(places[0], place) for place in places) < SENSOR_SPACING_MM:
        farthest_mm = max(math.sqrt(sum(one * one for one in place)) for place in places)
        yield (
            ("geometry", "sensors_mm"),
            f"all sensors are within {farthest_mm:.3g} mm of the origin: is it in metres? Give millimetres",
        )
        return
    for (first, one), (second, other) in combinations(enumerate(places[:MAX_SENSORS]), 2):
        if math.dist(one, other) < SENSOR_SPACING_MM:
            yield (
                ("geometry", "sensors_mm", second),
                f"is within {SENSOR_SPACING_MM:g} mm of sensor {first + 1} (these are millimetres)",
            )
    rotations = pad.geometry.sensor_rotations_deg
    if rotations and len(rotations) != len(places):
        yield (
            ("geometry", "sensor_rotations_deg"),
            f"either empty or one rotation vector for each of the {len(places)} sensors, not {len(rotations)}",
        )


def _rest(pad: PadConfig) -> Iterator[Problem]:
    yield from _rest_of(pad, pad.magnet, ("magnet",))
    for number, magnet in enumerate(pad.other_magnets):
        yield from _rest_of(pad, magnet, ("other_magnets", number))


def _rest_of(pad: PadConfig, magnet: MagnetConfig, where: tuple[Key, ...]) -> Iterator[Problem]:
    rest, axis = magnet.rest_mm, magnet.rest_axis
    if max(map(abs, axis)) < 1e-6:
        yield (*where, "rest_axis"), "the length of this vector is 0: give a direction"
    half_mm = min(magnet.diameter_mm, magnet.length_mm) / 2.0
    if rest[2] - max((place[2] for place in pad.geometry.sensors_mm), default=0.0) < half_mm:
        yield (
            (*where, "rest_mm"),
            f"the magnet rests above the sensors: its z must be greater than theirs by {half_mm:g} mm, half its size"
            + (IN_METRES if 0.0 < rest[2] < half_mm <= rest[2] * 1e3 else ""),
        )
    distance_mm = min((math.dist(rest, place) for place in pad.geometry.sensors_mm), default=math.inf)
    if distance_mm < CLOSEST_MM:
        yield (*where, "rest_mm"), f"at least {CLOSEST_MM} mm from every sensor, not {distance_mm:.3g} mm"
    if distance_mm > FARTHEST_MM:
        yield (
            (*where, "rest_mm"),
            f"the nearest sensor is {distance_mm:.3g} mm away and would feel next to nothing (these are millimetres)",
        )


def _model(pad: PadConfig) -> Iterator[Problem]:
    if pad.contact.model not in (NO_MODEL, *SHIPPED_PATHS) and not Path(pad.contact.model).is_file():
        yield (
            ("contact", "model"),
            f'neither "default" nor "shear" nor "none" nor a file: there is no {pad.contact.model}',
        )


def _slip(pad: PadConfig) -> Iterator[Problem]:
    if pad.contact.slip and (pad.contact.model in (NO_MODEL, "default") or pad.other_magnets or pad.model_kind):
        yield (
            ("contact", "slip"),
            'needs a model with shear; other models mistake shear for a moving finger: set model = "shear", or '
            "a model of `calibrate --shear`",
        )
    if pad.contact.slip and pad.contact.friction == 0.0:
        yield (
            ("contact", "friction"),
            "slip = true reports fingers that shear, and 0 says that none can: set friction above 0, or slip = false",
        )
    if not 0.0 < pad.contact.slip_friction[0] < pad.contact.slip_friction[1]:
        yield ("contact", "slip_friction"), "the smallest friction must be above 0 and below the largest"


def _kind_of_model(pad: PadConfig) -> Iterator[Problem]:
    if pad.model_kind is not None:
        yield from pad.model_kind.problems(pad)
    elif not pad.other_magnets and (how := lacking(pad.contact.model)) is not None:
        yield ("contact", "model"), how


def other_silicone(pad: PadConfig) -> str | None:
    """A warning where a shipped model is used with another simulated slab than it was made for, else None.

    A model's file does not contain the mechanics that it was made for.
    """
    source = pad.source
    if isinstance(source, SimulatedSource) and source.mechanics != "standard" and pad.contact.model in SHIPPED_PATHS:
        return (
            f"[pad.source] mechanics is {source.mechanics}, but [pad.contact] model {pad.contact.model!r} was made for "
            "the standard slab: places and forces will be wrong; calibrate this one (docs/calibration.md) and set model"
        )
    return None


def _names(pads: Sequence[PadConfig]) -> Iterator[Problem]:
    for number, pad in enumerate(pads):
        if any(pad.name == earlier.name for earlier in pads[:number]):
            yield ("pad", number, "name"), "another pad has this name"
