"""A hand of five pads in a world that turns, holds steel and warms up: the field at every sensor, at every moment."""

from __future__ import annotations

from math import cos, pi, sin
from typing import NamedTuple

import numpy as np

from fmfts.config import Config, PadConfig
from fmfts.pad import Array, Placement, rotation_from_vector
from fmfts.pose import dipole_field
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.mounted import MountedPad, with_chips_turned
from fmfts_simulation.source import tumbled

NAMES = ("thumb", "index", "middle", "ring", "little")
# Where the pads sit on an open hand, in mm and degrees about z.
PLACES = ((-72, 12, 38), (-46, 78, 9), (1, 90, 0), (48, 80, -7), (91, 55, -16))
SEED = 5
EARTH_T = 4.8e-5
TURNING_RAD_PER_S = 0.54
CYCLE_S = 44.0
FELT_M = 0.1  # of another pad's magnet
TOOL_A_M2 = 0.02  # dipole moment of a magnetised screwdriver
WARMER_K, REMANENCE_PER_K, ROOM_C = 15.0, -0.0012, 25.0
MU0_4PI = 1e-7
# Chips placed by a machine, as tolerance.sensor_rotation_deg says; hand-placed ones need `baseline --turn` first.
CHIP_TURN_RAD, CROSS_AXIS = float(np.deg2rad(0.3)), 0.002


def config_of(ports: list[str]) -> str:
    """The configuration of the five pads; each names those beside it as its neighbours."""
    parts = []
    for number, (name, (x, y, turn)) in enumerate(zip(NAMES, PLACES, strict=True)):
        beside = ", ".join(f'"{NAMES[other]}"' for other in (number - 1, number + 1) if 0 <= other < len(NAMES))
        parts.append(
            f"""
[[pad]]
name = "{name}"
[pad.source]
type = "bridge"
port = "{ports[number]}"
range_gauss = 4.0
[pad.tolerance]
sensor_rotation_deg = 0.5
[pad.scene]
steel_nearby = true
neighbours = [{beside}]
[pad.placement]
position_mm = [{x}, {y}, 0]
rotation_deg = [0, 0, {turn}]
"""
        )
    return "\n".join(parts)


class Act(NamedTuple):
    """Events from `begin_s` of each cycle on."""

    begin_s: float
    text: str


ACTS = (
    Act(0.0, "The hand turns in the Earth's field. Nothing touches it."),
    Act(10.0, "It grips a thing, and keeps turning."),
    Act(18.0, "It lets go. A steel tool passes index and middle."),
    Act(26.0, "The ring finger's board is unplugged …"),
    Act(30.0, "… and plugged in again."),
    Act(34.0, "The little finger's pad warms by 15 K. Nothing touches it."),
)
UNPLUGGED_S = (26.0, 30.0)


def act_at(time_s: float) -> Act:
    return [act for act in ACTS if act.begin_s <= time_s % CYCLE_S][-1]


def _between(time_s: float, begin_s: float, end_s: float, ramp_s: float) -> float:
    """1 from begin to end, 0 elsewhere, with smooth ramps inside."""
    rise = min(max(min(time_s - begin_s, end_s - time_s) / ramp_s, 0.0), 1.0)
    return (1.0 - cos(pi * rise)) / 2.0


def _direction(chance: np.random.Generator) -> Array:
    """A unit vector of any direction."""
    vector = chance.standard_normal(3)
    unit: Array = vector / np.linalg.norm(vector)
    return unit


class HandWorld:
    """The built pads, with errors of mounting, and what moves around them. Each seed is another world."""

    def __init__(self, config: Config, seed: int = SEED) -> None:
        self._configs: list[PadConfig] = list(config.pad)
        chance = np.random.default_rng(seed)
        errors = with_chips_turned(CHIP_TURN_RAD, CROSS_AXIS)
        self._pads = [MountedPad.built(pad.pad(), chance, errors=errors) for pad in self._configs]
        self._placements = [pad.placement.si() for pad in self._configs]
        self._earth_t = EARTH_T * _direction(chance)
        self._turning_axis, self._tool_axis = _direction(chance), _direction(chance)

    def touch(self, number: int, time_s: float) -> tuple[float, float, float]:
        """x and y (m) and force (N) of the grip on this pad."""
        now = time_s % CYCLE_S
        force = (0.7 + 0.15 * number) * _between(now, 11.0 + 0.15 * number, 17.4, 0.5)
        return (-1) ** number * 3e-3 + 2e-3 * sin(0.9 * now), 2e-3 * cos(0.8 * now + number), force

    def earth_t(self, time_s: float) -> Array:
        """The Earth's field in the hand's axes; at 0 s the hand has the attitude of its baselines."""
        field: Array = rotation_from_vector(self._turning_axis * TURNING_RAD_PER_S * time_s).T @ self._earth_t
        return field

    def tumbling_t(self, time_s: float) -> Array:
        """The same while it is turned for `baseline --turn`: once about each axis, from the standing hand on."""
        field: Array = tumbled(self._earth_t, np.array([time_s]))[0]
        return field

    def warming_k(self, number: int, time_s: float) -> float:
        return WARMER_K * _between(time_s % CYCLE_S, 34.0, 44.0, 3.0) if number == len(NAMES) - 1 else 0.0

    def untouched(self, number: int, earth_t: Array, *, mounted: bool = True) -> Array:
        """(N, 3) what the chips of pad `number` sense while nothing touches the hand and no tool is near."""
        return self._sensed(number, 0.0, earth_t, still=True, mounted=mounted)

    def field(self, number: int, time_s: float) -> Array:
        """(N, 3) what the chips of pad `number` sense at a moment of the play."""
        return self._sensed(number, time_s, self.earth_t(time_s), still=False, mounted=True)

    def _sensed(self, number: int, time_s: float, earth_t: Array, *, still: bool, mounted: bool) -> Array:
        built, placement = self._pads[number], self._placements[number]
        field = np.tile(placement.rotation.T @ earth_t, (len(built.pad.sensors), 1))
        for other in range(len(NAMES)):
            if other == number and not mounted:
                continue
            offset = self._placements[other].seen_from(placement)
            if float(np.linalg.norm(offset.position_m)) < FELT_M:
                field = field + self._magnet(other, time_s, still, offset.position_m, offset.rotation, built)
        if not still:
            field = field + self._tool(placement, time_s, built)
        return built.sensed(field)

    def _magnet(
        self, other: int, time_s: float, still: bool, position_m: Array, rotation: Array, built: MountedPad
    ) -> Array:
        pad = self._pads[other]
        press = (0.0, 0.0, 0.0) if still else self.touch(other, time_s)
        at, axis = pad.pose(*(np.array([value]) for value in press))
        warm_k = 0.0 if still else self.warming_k(other, time_s)
        magnet = pad.pad.magnet.with_remanence(pad.pad.magnet.remanence_t * (1.0 + REMANENCE_PER_K * warm_k))
        places = built.pad.sensors.position_m
        at, axis = np.tile(position_m + at @ rotation.T, (len(places), 1)), np.tile(axis @ rotation.T, (len(places), 1))
        if position_m.any():  # at the next finger a cylinder's field is a dipole's
            return dipole_field(places, at[0], axis[0], magnet.strength_t_m3)
        return cylinder_field(places, at, axis, magnet)

    def _tool(self, placement: Placement, time_s: float, built: MountedPad) -> Array:
        """The dipole field of a magnetised tool that is led past index and middle, 45 mm above them."""
        now = time_s % CYCLE_S
        share = min(max((now - 18.5) / 7.0, 0.0), 1.0)
        at = np.array([-0.16 + 0.30 * share, 0.085, 0.045])
        moment = TOOL_A_M2 * self._tool_axis * _between(now, 18.5, 25.5, 1.0)
        way = placement.position_m + built.pad.sensors.position_m @ placement.rotation.T - at
        distance = np.linalg.norm(way, axis=1)[:, None]
        along = (way @ moment)[:, None]
        field = MU0_4PI * (3.0 * along * way / distance**5 - moment / distance**3)
        in_pad_axes: Array = field @ placement.rotation
        return in_pad_axes
