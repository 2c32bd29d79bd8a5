"""Foreign fields: steel, a motor, another pad's magnet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts_lab.study.hazards import BEGIN_S, Cell, cell_of, pressing
from fmfts_lab.study.world import Path, drawn_world
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.mounted import MountedPad


def steel(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    """A steel ball of 10 mm in the fields of magnet and Earth (J. D. Jackson, Classical Electrodynamics, 5.11)."""
    world = drawn_world(config)
    for distance_mm in (20, 30, 40, 60, 80):

        def foreign(path: Path, built: MountedPad, end_m: float = distance_mm * 1e-3) -> Array:
            place = _approaching(path, end_m)
            pad = built.pad
            own = cylinder_field(place, path.position_m, path.axis, pad.magnet) + built.ambient_t
            return _dipoles(pad.sensors.position_m, place, 5e-3**3 * own)

        changed = replace(world, foreign=(foreign,))
        yield cell_of("steel tool", f"{distance_mm} mm", False, changed, pressing(changed, random, seconds))


def motor(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    """A rotor of 0.1 A·m² that turns 31 times a second, switched on."""
    world = drawn_world(config)
    for distance_mm in (40, 60, 100, 150, 250):

        def foreign(path: Path, built: MountedPad, end_m: float = distance_mm * 1e-3) -> Array:
            angle = 2.0 * np.pi * 31.0 * path.time_s
            on = path.time_s >= BEGIN_S
            moment = 1e-7 * 0.1 * np.stack([np.cos(angle) * on, np.sin(angle) * on, 0.0 * angle], axis=1)
            place = np.tile([end_m, 0.0, 10e-3], (len(angle), 1))
            return _dipoles(built.pad.sensors.position_m, place, moment)

        changed = replace(world, foreign=(foreign,))
        yield cell_of("motor", f"{distance_mm} mm", False, changed, pressing(changed, random, seconds))


def neighbour(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    """An equal magnet that its own finger presses twice a second; the methods do not know of it."""
    world = drawn_world(config)
    for distance_mm in (20, 30, 45, 60, 100, 150):

        def foreign(path: Path, built: MountedPad, away_m: float = distance_mm * 1e-3) -> Array:
            down = (1.0 - np.cos(4.0 * np.pi * np.maximum(path.time_s - BEGIN_S, 0.0))) / 2.0
            place = built.pad.rest_position_m + np.stack([0 * down + away_m, 0 * down, -1e-3 * down], axis=1)
            axis = np.stack([np.sin(0.2 * down), 0 * down, np.cos(0.2 * down)], axis=1)
            magnet, sensors = built.pad.magnet, built.pad.sensors.position_m
            moving = cylinder_field(sensors, place[:, None], axis[:, None], magnet)
            # The baseline has subtracted the neighbour's field at rest.
            return moving - cylinder_field(sensors, place[:1, None], axis[:1, None], magnet)

        changed = replace(world, foreign=(foreign,))
        healthy = distance_mm >= 150
        yield cell_of("neighbour", f"{distance_mm} mm", healthy, changed, pressing(changed, random, seconds))


def _approaching(path: Path, end_m: float) -> Array:
    """(K, 3) places of something that approaches from 60 mm farther away within half a second."""
    share = np.clip((path.time_s - BEGIN_S) / 0.5, 0.0, 1.0)
    x = np.where(path.time_s < BEGIN_S, 10.0, end_m + 60e-3 * (1.0 - share))
    return np.stack([x, 0 * x, 0 * x + 10e-3], axis=1)


def _dipoles(sensors_m: Array, place_m: Array, moment_t_m3: Array) -> Array:
    """(K, N, 3) fields of dipoles at places (K, 3)."""
    r = sensors_m - place_m[:, None]
    square = np.sum(r * r, axis=2, keepdims=True)
    along = np.sum(r * moment_t_m3[:, None], axis=2, keepdims=True)
    field_t: Array = (3.0 * along * r / square - moment_t_m3[:, None]) / square**1.5
    return field_t
