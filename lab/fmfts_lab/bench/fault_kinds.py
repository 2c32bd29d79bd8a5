"""The kinds of fault of a pad: the readings of broken sensors, and foreign fields."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import pi

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array, rotation_from_vector
from fmfts.pose import dipole_field
from fmfts.sensor.chips import DEFAULT_CHIP, TESLA_PER_GAUSS
from fmfts_simulation.finger import Touch
from fmfts_simulation.mounted import MountedPad
from fmfts_simulation.source import TURNING_AXIS

Counts = NDArray[np.int16]
# Counts (N, 3) as the chips have them → as they arrive; called for each frame with the counts before the fault.
CountFault = Callable[[Counts, Counts], Counts]
# Time since the fault began (s) and the pad then → field (N, 3) at its sensors, in pad axes.
FieldFault = Callable[[float, "PadThen"], Array]

LAST_COUNT, SATURATED = DEFAULT_CHIP.largest_count, DEFAULT_CHIP.saturated_count


@dataclass(frozen=True, slots=True)
class PadThen:
    """A pad at one moment. magnets_t: places (K, 3) in m → the field (M, K, 3) in T of each of its magnets."""

    built: MountedPad
    touch: Touch
    magnets_t: Callable[[Array], Array]

    @property
    def places_m(self) -> Array:
        """The places (N, 3) of its sensors."""
        return self.built.pad.sensors.position_m


@dataclass(frozen=True, slots=True)
class Fault:
    """kind: its name in the table. sensor: the one that the daemon must name, None if the field itself is foreign.

    counts, field: its effect. valid: whether the sensor still answers. swapped: two sensors whose wires are exchanged.
    """

    kind: str
    sensor: int | None = None
    counts: CountFault | None = None
    field: FieldFault | None = None
    valid: bool = True
    swapped: tuple[int, int] | None = None


def sensor_faults(sensors: Sequence[int], axes: Sequence[int], gain_code: int = 3) -> list[Fault]:
    """All kinds of sensor fault, for each of these sensors and axes. gain_code: of the chips' range."""
    faults = [Fault("invalid", sensor, valid=False) for sensor in sensors]
    for sensor in sensors:
        for axis in axes:
            at = (sensor, axis)
            faults += [
                Fault("saturated", sensor, _set(at, lambda now, before: SATURATED)),
                Fault("stuck", sensor, _set(at, lambda now, before: before)),
                *(
                    Fault(f"offset {offset_mg} mG", sensor, _set(at, _added(offset_mg * 1e-3, gain_code)))
                    for offset_mg in (30, 100)
                ),
                *(Fault(f"gain {percent} %", sensor, _set(at, _scaled(1.0 + percent / 100))) for percent in (2, 5)),
            ]
    return faults


def _set(at: tuple[int, int], change: Callable[[int, int], float]) -> CountFault:
    def apply(now: Counts, before: Counts) -> Counts:
        counts = now.copy()
        if now[at] != SATURATED:
            changed = round(change(int(now[at]), int(before[at])))
            counts[at] = changed if abs(changed) <= LAST_COUNT else SATURATED
        return counts

    return apply


def _added(gauss: float, gain_code: int) -> Callable[[int, int], float]:
    counts = gauss * DEFAULT_CHIP.counts_per_gauss[gain_code][0]  # all axes alike
    return lambda now, before: now + counts


def _scaled(factor: float) -> Callable[[int, int], float]:
    return lambda now, before: now * factor


def field_faults(wires: Iterable[tuple[int, int]] = tuple(combinations(range(4), 2))) -> list[Fault]:
    """The faults of the surroundings, not of a sensor. wires: the pairs of sensors whose wires are swapped."""
    faults = [
        Fault(f"neighbour {distance_mm} mm, {how}", field=_neighbour(distance_mm * 1e-3, how == "moving"))
        for distance_mm in (30, 45, 60, 80, 100)
        for how in ("fixed", "moving")
    ]
    faults.append(Fault("steel approaching", field=_steel))
    faults += [Fault(f"field step {step_mg} mG", field=_step(step_mg * 1e-3)) for step_mg in (10, 30, 100)]
    faults += [Fault(f"turning {deg_per_s} deg/s", field=_turning(deg_per_s)) for deg_per_s in (2, 5, 20)]
    faults += [Fault(f"wires {one + 1} and {other + 1} swapped", swapped=(one, other)) for one, other in wires]
    faults.append(Fault("magnet lost, returned", field=weaker(1.0, until_s=0.6)))
    faults.append(Fault("demagnetised to half", field=weaker(0.5)))
    return faults


def _neighbour(distance_m: float, moving: bool) -> FieldFault:
    """An equal magnet beside this one; moving: a finger of its own presses and tilts it twice a second."""

    def field(time_s: float, then: PadThen) -> Array:
        down = (1.0 - np.cos(4 * pi * time_s)) / 2.0 if moving else 0.0
        place = then.built.pad.rest_position_m + np.array([distance_m, 0.0, -1e-3 * down])
        axis = np.array([np.sin(0.2 * down), 0.0, np.cos(0.2 * down)])
        return dipole_field(then.places_m, place, axis, then.built.pad.magnet.strength_t_m3)

    return field


def _steel(time_s: float, then: PadThen) -> Array:
    """A steel ball of 10 mm that comes from 80 to 30 mm in a second. Its moment is 3V/µ0 times the field at its place.

    J. D. Jackson, Classical Electrodynamics, 5.11: a sphere of µ ≫ 1 in a uniform field.
    """
    place = np.array([80e-3 - 50e-3 * min(time_s, 1.0), 0.0, 10e-3])
    inducing = then.magnets_t(place[None]).sum(axis=0)[0] + then.built.ambient_t
    # dipole_field's strength is µ0·m/4π; a sphere's is R³·B.
    strength = 5e-3**3 * float(np.linalg.norm(inducing))
    return dipole_field(then.places_m, place, inducing / np.linalg.norm(inducing), strength)


def _step(gauss: float) -> FieldFault:
    direction = np.array([0.6, -0.64, 0.48]) * gauss * TESLA_PER_GAUSS
    return lambda time_s, then: np.tile(direction, (len(then.places_m), 1))


def _turning(deg_per_s: float) -> FieldFault:
    """The robot begins to turn in the Earth's field, which a constant scene excludes."""

    def field(time_s: float, then: PadThen) -> Array:
        turn = rotation_from_vector(TURNING_AXIS * np.deg2rad(deg_per_s) * time_s)
        return np.tile(turn @ then.built.ambient_t - then.built.ambient_t, (len(then.places_m), 1))

    return field


def weaker(share: float, until_s: float = np.inf, magnets: slice = slice(None)) -> FieldFault:
    """These magnets lose `share` of their moments, and have them again after `until_s`."""

    def field(time_s: float, then: PadThen) -> Array:
        if time_s > until_s:
            return np.zeros(then.places_m.shape)
        return np.asarray(-share * then.magnets_t(then.places_m)[magnets].sum(axis=0))

    return field
