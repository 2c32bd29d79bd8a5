"""The hazards where methods may fail. Each is a dimension of conditions, from harmless to hopeless."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts_lab.bench.fault_kinds import LAST_COUNT, SATURATED
from fmfts_lab.study.world import Counts, Path, World, drawn_world, frame_times, pressed, presses
from fmfts_simulation.mounted import MountedPad

Mask = NDArray[np.bool_]

BEGIN_S = 0.3  # when the fault begins
EVERY_REST = 4  # a path that jumps has three samples at rest, then one elsewhere
MILLIGAUSS = 1e-7
PRESSED_M = 1e-3  # a finger moves the magnet down this far; a magnet that is pulled up means a faulty pad


@dataclass(frozen=True, slots=True)
class Cell:
    """One condition. healthy: the condition is within the scene's settings, so that any flag is a false alarm.
    judged (K,): samples that count. second: the position on the second axis, of dimensions with two axes."""

    dimension: str
    condition: str
    healthy: bool
    world: World
    path: Path
    second: str = ""
    judged: Mask = field(default_factory=lambda: np.ones(0, dtype=np.bool_))

    @property
    def name(self) -> str:
        return ", ".join(part for part in (self.dimension, self.condition, self.second) if part)


class Hazard(NamedTuple):
    """why: the reason why methods fail there. avoided: the setting that avoids it."""

    dimension: str
    cells: Callable[[PadConfig, np.random.Generator, float], Iterator[Cell]]
    why: str
    avoided: str


def cell_of(
    dimension: str,
    condition: str,
    healthy: bool,
    world: World,
    path: Path,
    second: str = "",
    judged: Mask | None = None,
) -> Cell:
    every = np.ones(len(path.time_s), dtype=np.bool_)
    return Cell(dimension, condition, healthy, world, path, second, every if judged is None else judged)


def pressing(world: World, random: np.random.Generator, seconds: float) -> Path:
    time_s = frame_times(seconds, world.rate_hz)
    return pressed(world.built, time_s, presses(time_s, random))


def _jumping(world: World, random: np.random.Generator, seconds: float, far_m: float, turn_rad: float) -> Path:
    """A path that jumps from rest to a pose `far_m` away and turned by `turn_rad`, within one frame, and back."""
    time_s = frame_times(seconds, world.rate_hz)
    count = len(time_s)
    jumps = np.arange(count) % EVERY_REST == EVERY_REST - 1
    away, across = random.normal(size=(count, 3)), random.uniform(0.0, 2.0 * np.pi, count)
    # Down to a finger's deepest press; larger displacements go upward, away from the sensors.
    away[:, 2] = np.abs(away[:, 2]) * (-1.0 if far_m <= PRESSED_M else 1.0)
    position = world.drawing.rest_position_m + (
        far_m * jumps[:, None] * away / np.linalg.norm(away, axis=1, keepdims=True)
    )
    turn = turn_rad * jumps
    axis = np.stack([np.sin(turn) * np.cos(across), np.sin(turn) * np.sin(across), np.cos(turn)], axis=1)
    turned = axis @ world.built.rest_axis_from_z.T
    return Path(time_s, position, turned, np.full((count, 3), np.nan))


def _jumped(path: Path) -> Mask:
    return np.asarray(np.arange(len(path.time_s)) % EVERY_REST == EVERY_REST - 1, dtype=np.bool_)


def start_error(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    for far_mm in (0.0, 0.5, 1.0, 2.0, 4.0, 8.0):
        for turn_deg in (0, 15, 45, 90, 135, 180):
            path = _jumping(world, random, seconds, far_mm * 1e-3, float(np.deg2rad(turn_deg)))
            healthy = far_mm * 1e-3 <= PRESSED_M and turn_deg <= 15
            yield cell_of("start error", f"{far_mm:g} mm", healthy, world, path, f"{turn_deg}°", _jumped(path))


def speed(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    for press_s in (0.8, 0.4, 0.2, 0.1, 0.05, 0.02):
        for rate_hz in (220.0, 110.0, 55.0, 27.5):
            world = replace(drawn_world(config), rate_hz=rate_hz)
            time_s = frame_times(max(seconds, 40.0 / rate_hz), rate_hz)
            path = pressed(world.built, time_s, presses(time_s, random, press_s=press_s, force_n=(1.0, 1.9)))
            healthy = rate_hz >= 110.0
            yield cell_of("finger speed", f"{press_s * 1e3:g} ms", healthy, world, path, f"{rate_hz:g} Hz")


def missing(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    sensors = range(len(world.drawing.sensors))
    path = pressing(world, random, seconds)
    for gone in [*((one,) for one in sensors), *((one, two) for one in sensors for two in sensors if one < two)]:
        broken = _set(path, [(sensor, axis) for sensor in gone for axis in range(3)], SATURATED)
        named = " and ".join(str(sensor + 1) for sensor in gone)
        yield cell_of("missing sensor", named, False, replace(world, broken=broken), path)


def saturation(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    path = pressing(world, random, seconds)
    for count in (1, 2, 3, 4, 6):
        axes = [(place % 4, 2 - place // 4) for place in range(count)]
        yield cell_of("saturation", f"{count} axes", False, replace(world, broken=_set(path, axes, SATURATED)), path)
    yield cell_of(
        "saturation", "1 axis, unmarked", False, replace(world, broken=_set(path, [(0, 2)], LAST_COUNT)), path
    )


def _set(path: Path, axes: list[tuple[int, int]], count: int) -> Callable[[Counts], Counts]:
    """These axes (sensor, axis) read `count` from the beginning of the fault on."""
    begin = int(np.searchsorted(path.time_s, BEGIN_S))

    def broken(counts: Counts) -> Counts:
        spoiled = counts.copy()
        for sensor, axis in axes:
            spoiled[begin:, sensor, axis] = count
        return spoiled

    return broken


def noise(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    for times in (1, 3, 10, 30, 100):
        noisy = replace(world, noise_t=times * world.noise_t)
        yield cell_of("noise", f"×{times}", times <= 10, noisy, pressing(noisy, random, seconds))


def ambient_offset(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    for offset_mg in (1, 5, 20, 100, 500):
        step = offset_mg * MILLIGAUSS * np.array([0.6, -0.64, 0.48])

        def foreign(path: Path, built: MountedPad, step: Array = step) -> Array:
            return np.asarray((path.time_s >= BEGIN_S)[:, None, None] * step)

        changed = replace(world, foreign=(foreign,))
        yield cell_of("ambient step", f"{offset_mg} mG", False, changed, pressing(changed, random, seconds))


def turning(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    for speed_deg in (10, 30, 60, 120, 360):
        world = drawn_world(config, float(speed_deg))
        yield cell_of("turning", f"{speed_deg}°/s", speed_deg <= 60, world, pressing(world, random, seconds))


def remanence(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    for remanence_t in (0.3, 0.6, 0.9, 1.1, 1.23, 1.4, 1.6):
        pad = replace(world.built.pad, magnet=world.built.pad.magnet.with_remanence(remanence_t))
        other = replace(world, built=replace(world.built, pad=pad), range_gauss=4.0)
        healthy = 1.1 <= remanence_t <= 1.4
        yield cell_of("remanence", f"{remanence_t} T", healthy, other, pressing(other, random, seconds))


def distance(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    """Other distances between magnet and sensors, with the same displacements under the same presses."""
    for height_mm in (3.0, 5.0, 8.0, 12.0, 16.0, 20.0, 25.0, 30.0):
        magnet = msgspec.structs.replace(config.magnet, rest_mm=(0.0, 0.0, height_mm))
        world = replace(drawn_world(msgspec.structs.replace(config, magnet=magnet)), range_gauss=8.1)
        yield cell_of("distance", f"{height_mm:g} mm", False, world, pressing(world, random, seconds))


def gains(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    for share in (0.001, 0.005, 0.01, 0.02, 0.05):
        built = replace(world.built, gain=random.normal(1.0, share, world.built.gain.shape))
        other = replace(world, built=built)
        yield cell_of("gain errors", f"{share:.1%}", share <= 0.005, other, pressing(other, random, seconds))


def warming(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    for warmer_k in (2, 5, 10, 20):
        other = replace(world, warming_k_per_s=warmer_k / seconds)
        yield cell_of("warming", f"{warmer_k} K", True, other, pressing(other, random, seconds))


def symmetric(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    poses = {"at rest": (0.0, 0.0), "tilted 45°": (0.0, 45.0), "lying": (0.0, 90.0), "upside down": (0.0, 180.0)}
    for name, (far_m, turn_deg) in poses.items():
        path = _jumping(world, random, seconds, far_m, float(np.deg2rad(turn_deg)))
        if name != "at rest":  # alternately along a diagonal and along an edge
            azimuth = np.where(np.arange(len(path.axis)) % 8 < 4, 0.0, np.pi / 4)
            across = np.hypot(path.axis[:, 0], path.axis[:, 1])
            path.axis[:, :2] = across[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
        yield cell_of("symmetric pose", name, name == "at rest", world, path, "", _jumped(path))


def timing(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    every = frame_times(seconds, world.rate_hz)
    for share in (0.01, 0.1, 0.5, 0.9):
        kept = every[(random.uniform(size=len(every)) >= share) | (every < BEGIN_S)]
        path = pressed(world.built, kept, presses(kept, random))
        yield cell_of("lost frames", f"{share:.0%}", share <= 0.1, world, path)
    for jitter_ms in (1.0, 2.0, 4.0):
        late = every + random.uniform(0.0, jitter_ms * 1e-3, len(every))
        path = pressed(world.built, late, presses(late, random))
        yield cell_of("jitter", f"{jitter_ms:g} ms", True, world, path)


def edge(config: PadConfig, random: np.random.Generator, seconds: float) -> Iterator[Cell]:
    world = drawn_world(config)
    time_s = frame_times(seconds, world.rate_hz)
    for name, place_mm in {"centre": (0, 0), "4 mm": (4, 0), "8 mm": (8, 0), "11 mm": (11, 0), "edge": (14, 0),
                           "corner": (14, 14)}.items():  # fmt: skip
        press = presses(time_s, random)
        press[:, :2] = place_mm
        yield cell_of("place", name, True, world, pressed(world.built, time_s, press))
