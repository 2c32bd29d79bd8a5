"""The limits of a scene besides its model, and what would have to change for a larger model to be worthwhile."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import msgspec
import numpy as np

from fmfts.config import BridgeSource, I2cSource, PadConfig
from fmfts.pad import Array, Pad
from fmfts.pose import dipole_field
from fmfts.sensor.chips import CHIPS, TESLA_PER_GAUSS, Chip
from fmfts.sensor.chips.rates import BusLoad, highest_rate_hz, i2c_rate_hz
from fmfts_lab.calibration.simulated import magnet_fields
from fmfts_lab.scene import AMBIENT_CHANGE_T, WORTH, WORTH_OF_TERM, Cost, Model, Surroundings, costs


def limits(surroundings: Surroundings) -> list[str]:
    return [_range(surroundings), _rate(surroundings)]


def would_pay(surroundings: Surroundings, best: Cost) -> list[str]:
    """For each model that is one step larger: how much larger its cause would have to be to make it worthwhile."""
    lines = []
    for cause, larger, words in _steps(surroundings, best.model):
        strong = surroundings
        if cause == "ambient":
            strong = replace(surroundings, config=_drifting(surroundings))
        found = {cost.model: cost for cost in costs(strong)}
        left, taken = found[best.model], found[larger]
        # error² of the smaller model: a part without this cause, plus k² times this cause's part. Finds k for `worth`.
        worth = WORTH_OF_TERM if larger.unknown == best.model.unknown else WORTH
        anyway = max(left.error**2 - left.bias_of[cause] ** 2, 0.0)
        room = ((1.0 + worth) * taken.error) ** 2 - anyway
        if left.bias_of[cause] < 1e-9:
            lines.append(f"{larger} would never pay here")
        else:
            lines.append(f"{larger} would pay with {words(np.sqrt(max(room, 0.0)) / left.bias_of[cause])}")
    return lines


def _steps(surroundings: Surroundings, model: Model) -> Iterator[tuple[str, Model, Callable[[float], str]]]:
    if model.unknowns == 6:
        ambient = AMBIENT_CHANGE_T * 1e7
        yield "ambient", replace(model, unknowns=8), lambda k: f"an ambient field that changes by {k * ambient:.2g} mG"
    if not model.cylinder:
        yield (
            "cylinder",
            replace(model, cylinder=True),
            lambda k: f"a magnet {k:.2g} times as strong, or as much less noise (frames averaged: {k * k:.2g})",
        )
    for other in surroundings.others[len(model.neighbours) : len(model.neighbours) + 1]:
        away_mm = (
            float(np.linalg.norm(other.placement.si().seen_from(surroundings.config.placement.si()).position_m)) * 1e3
        )
        beside = tuple(each.name for each in surroundings.others[: len(model.neighbours) + 1])
        yield f"pad '{other.name}'", replace(model, neighbours=beside), partial(_nearer, other.name, away_mm)


def _nearer(name: str, away_mm: float, factor: float) -> str:
    """Distance for a `factor` more effect: a dipole's field goes with 1/r³, its change by a step with 1/r⁴."""
    return f"pad '{name}' at about {away_mm * factor**-0.25:.0f} mm"


def _drifting(surroundings: Surroundings) -> PadConfig:
    scene = msgspec.structs.replace(surroundings.config.scene, ambient="drifting")
    return msgspec.structs.replace(surroundings.config, scene=scene)


def recommended_range_gauss(surroundings: Surroundings) -> float | None:
    """The finest range without saturation under the hardest press, the Earth's field and the worst gains, or None."""
    needed = largest_field_gauss(surroundings) * (1.0 + surroundings.config.tolerance.gain)
    chip = CHIPS[surroundings.config.source.chip]
    return next((each for each in sorted(chip.ranges_gauss) if saturation_gauss(chip, each) > needed), None)


def saturation_gauss(chip: Chip, range_gauss: float) -> float:
    """The field at the converter's last count, on the axis that reaches it first."""
    return chip.largest_count / max(map(abs, chip.counts_per_gauss[chip.gain_code_for_range(range_gauss)]))


def largest_field_gauss(surroundings: Surroundings) -> float:
    """The largest field on one axis of a sensor, for presses all over the pad, with the Earth's and the neighbours'."""
    pad, scale_n = surroundings.config.pad(), surroundings.response.scale_n
    places = np.linspace(surroundings.response.first_mm, surroundings.response.last_mm, 9)
    press = np.array([[x, y, f] for x in places[:, 0] for y in places[:, 1] for f in (0.0, scale_n)])
    change = surroundings.response.change(press)
    axis = np.column_stack([change[:, 3:], np.sqrt(1.0 - np.sum(change[:, 3:] ** 2, axis=1))])
    field = magnet_fields(pad, change[:, :3] * 1e-3, axis) + _beside_t(surroundings, pad)
    return float(np.abs(field).max() / TESLA_PER_GAUSS) + AMBIENT_CHANGE_T / TESLA_PER_GAUSS


def _beside_t(surroundings: Surroundings, pad: Pad) -> Array:
    """(N, 3) field of the neighbours' magnets at rest, in sensor axes."""
    field = np.zeros_like(pad.sensors.position_m)
    for other in surroundings.others:
        there = other.placement.si().seen_from(surroundings.config.placement.si())
        for one in other.pad().magnets:
            place, axis = there.point(one.rest_position_m), there.rotation @ one.rest_axis
            field += dipole_field(pad.sensors.position_m, place, axis, one.magnet.strength_t_m3)
    return pad.sensors.to_sensor(field)


def _range(surroundings: Surroundings) -> str:
    has, largest, best = (
        surroundings.config.source.range_gauss,
        largest_field_gauss(surroundings),
        recommended_range_gauss(surroundings),
    )
    chip = CHIPS[surroundings.config.source.chip]
    saturated = f"chips saturate at {saturation_gauss(chip, has):.2f} G"
    said = f"largest field on an axis: {largest:.2f} G; set to ±{has:g} G, {saturated}"
    if best is None:
        weaker = surroundings.config.magnet.remanence_t * saturation_gauss(chip, max(chip.ranges_gauss)) / largest
        return f"{said}: no range holds it; a remanence of at most {weaker:.2g} T, or a magnet farther away, would do"
    return said if best == has else f"{said}: recommended is ±{best:g} G"


def _rate(surroundings: Surroundings) -> str:
    source = surroundings.config.source
    chip = CHIPS[source.chip]
    most = highest_rate_hz(chip, source.trigger, over_bridge=isinstance(source, BridgeSource))
    if isinstance(source, I2cSource):
        sensors = len(surroundings.config.geometry.sensors_mm)
        on_bus = i2c_rate_hz(chip, source.trigger, source.clock_hz, BusLoad.of([(sensors, source.sensor_muxes)]))
        most = min(most, on_bus)
    if most < 220:
        return f"rate: {source.rate_hz} Hz, at most {most} for these chips, this trigger and this bus's clock; not 220"
    return f"rate: {source.rate_hz} Hz of {most}"
