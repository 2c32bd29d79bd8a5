"""A pad as built, in the Earth's field, for tests of baselines."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fmfts.baseline import Baseline, Means, Recording, make_bare, make_rest, means, turning_means
from fmfts.baseline.evenness import STRENGTH_DEVIATION
from fmfts.baseline.turn import UNEVEN_DEVIATION_T
from fmfts.baseline.unknowns import STANDING_AMBIENT_T
from fmfts.pad import Pad, Tolerance, rotation_from_vector
from fmfts.pose import State
from fmfts.sensor.frame import Frame
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.solved_table import standard_mechanics

NOISE_T = 2e-7
FRAMES = 660
TOLERANCE = Tolerance(1e-4, 1e-4, math.radians(1.0), 0.005, 0.05)


@dataclass
class World:
    """One pad, drawn from the priors of TOLERANCE, in an Earth's field; fields of the exact cylinder."""

    pad: Pad
    random: np.random.Generator

    def __post_init__(self) -> None:
        random = self.random
        self.turned, self.cross_axis = np.tile(np.eye(3), (4, 1, 1)), np.zeros((4, 3, 3))
        self.gain = 1.0 + random.normal(0.0, TOLERANCE.gain, (4, 3))
        self.places = self.pad.sensors.position_m + random.normal(0.0, TOLERANCE.sensor_position_m, (4, 3))
        step = np.concatenate([random.normal(0, 1e-4, 3), random.normal(0, np.radians(1), 2), np.zeros(4)])
        self.rest = State.at_rest(self.pad).stepped(step)
        self.remanence_t = 1.23 * float(np.exp(random.normal(0.0, TOLERANCE.remanence)))
        direction = random.normal(size=3)
        self.earth_t = 0.5e-4 * direction / np.linalg.norm(direction)

    def bare(self) -> np.ndarray:
        return self.sensed(self.earth_t + self.surroundings())

    def sensed(self, field_t: np.ndarray) -> np.ndarray:
        """The chips' reports of fields (…, 4, 3) in pad axes: turned by exact rotations, then skewed and scaled."""
        field_t = np.broadcast_to(field_t, np.broadcast_shapes(np.shape(field_t), (4, 3)))
        own = np.einsum("iba,...ib->...ia", self.turned, field_t)
        return self.gain * (own + np.einsum("iab,...ib->...ia", self.cross_axis, own))

    def surroundings(self) -> np.ndarray:
        """(3,) the change of the ambient field from one recording to the next."""
        return self.random.normal(0.0, STANDING_AMBIENT_T, 3)

    def field(self, state: State | None = None) -> np.ndarray:
        state = state or self.rest
        magnet = self.pad.magnet.with_remanence(self.remanence_t)
        positions, axes = np.tile(state.position_m, (4, 1)), np.tile(state.axis, (4, 1))
        return self.sensed(cylinder_field(self.places, positions, axes, magnet) + self.earth_t)

    def recorded(self, field: np.ndarray) -> Recording:
        mean = field + self.random.normal(0.0, NOISE_T / np.sqrt(FRAMES), field.shape)
        return Recording(mean, np.full((4, 3), NOISE_T), np.full(4, FRAMES), 3, 24.0, 3.0)

    def bare_baseline(self) -> Baseline:
        return make_bare(self.pad, TOLERANCE, self.recorded(self.bare()))

    def matrices(self) -> np.ndarray:
        """(4, 3, 3) sensitivities: what the chips report of unit fields along their axes in the drawing."""
        return np.stack([self.sensed(unit) for unit in np.eye(3)], axis=-1)

    def values(self) -> np.ndarray:
        """(36,) the same as gains, rotations and cross-axis terms."""
        found = self.matrices()
        x, y, z = range(3)
        across = found[:, [y, z, x], [z, x, y]], found[:, [z, x, y], [y, z, x]]
        gains = np.einsum("iaa->ia", found)
        parts = gains, (across[0] - across[1]) / 2.0, (across[0] + across[1]) / 2.0
        return np.concatenate([part.ravel() for part in parts])

    def spoilt(self, tolerance: Tolerance) -> None:
        """Chips of another `tolerance` than TOLERANCE."""
        self.gain = 1.0 + self.random.normal(0.0, tolerance.gain, (4, 3))
        if tolerance.sensor_rotation_rad:
            vectors = self.random.normal(0.0, tolerance.sensor_rotation_rad, (4, 3))
            self.turned = np.array([rotation_from_vector(vector) for vector in vectors])
        if tolerance.cross_axis:
            upper = np.triu(self.random.normal(0.0, tolerance.cross_axis, (4, 3, 3)), 1)
            self.cross_axis = upper + upper.transpose(0, 2, 1)

    def baseline(self, tolerance: Tolerance) -> Baseline:
        """Bare and rest."""
        bare = make_bare(self.pad, tolerance, self.recorded(self.bare()))
        return make_rest(self.pad, tolerance, self.recorded(self.field()), bare)[0]

    def pressed(self, x_m: np.ndarray, y_m: np.ndarray, force_n: np.ndarray) -> list[State]:
        """The magnet under presses (K,), its tilt on top of this pad's own."""
        moved, axes = standard_mechanics().displacement(x_m, y_m, force_n)
        tilted = axes + self.rest.axis - np.array([0.0, 0.0, 1.0])
        tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
        return [
            replace(self.rest, position_m=self.rest.position_m + move, axis=axis)
            for move, axis in zip(moved, tilted, strict=True)
        ]


RATE_HZ = 220.0
Fields = Callable[[np.ndarray], np.ndarray]


def frames_of(fields: Fields, seconds: float, random: np.random.Generator, noise_t: float = NOISE_T) -> list[Frame]:
    """Frames of free-running chips. `fields`: times (K, 4) of each sensor's samples → (K, 4, 3) in sensor axes."""
    count = round(seconds * RATE_HZ)
    age_s = np.append(0.0, random.uniform(0.0, 1.0 / RATE_HZ, 3))
    time_s = np.arange(1, count + 1)[:, None] / RATE_HZ
    seen = fields(time_s - age_s) + random.normal(0.0, noise_t, (count, 4, 3))
    counts = np.rint(seen / 1e-4 * 660).astype(np.int16)
    age_us, yes = np.rint(age_s * 1e6).astype(np.uint16), np.ones(4, bool)
    return [
        Frame(0, step, round(now * 1e6), round(now * 1e9), 3, counts[step], age_us, yes, yes, 25.0)
        for step, now in enumerate(time_s[:, 0])
    ]


def _rotations(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Matrices (…, 3, 3) that turn by `angle` (…) about the unit vector `axis` (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = angle[..., None, None]
    return np.eye(3) + np.sin(turn) * cross + (1.0 - np.cos(turn)) * (cross @ cross)


def turned(
    world: World,
    *,
    about: float = 1.0,
    touched: bool = False,
    seconds: float = 12.0,
    soft_iron: float = 0.0,
    speed: float = 1.0,
    noise_t: float = NOISE_T,
) -> Means:
    """The robot turned by hand in a workshop, at up to 2 rad/s: the field is as uneven as `--turn` counts with.

    about: share of the tilting that makes one turn three-dimensional. soft_iron: steel in the mount makes the field
    along x larger by this share, and smaller along y. speed: how much faster, and as many times around.
    """
    random = world.random
    strength = random.normal(0.0, STRENGTH_DEVIATION, (3, 3))
    away_m = np.linalg.norm(world.pad.sensors.position_m[0])
    gradient = random.normal(0.0, UNEVEN_DEVIATION_T / away_m, (3, 3))
    gradient = (gradient + gradient.T) / 2.0 - np.eye(3) * np.trace(gradient) / 3.0
    at_rest = world.field() - world.sensed(world.earth_t)
    press = world.field(world.pressed(np.array([2e-3]), np.array([1e-3]), np.array([0.3]))[0]) - world.field()
    direction = world.earth_t / np.linalg.norm(world.earth_t)
    across = np.cross(direction, [0.0, 0.0, 1.0] if abs(direction[2]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)

    def fields(times_s: np.ndarray) -> np.ndarray:
        angle = 2.0 * np.pi * speed * times_s / seconds
        tilt = _rotations(np.cross(direction, across), about * 1.2 * np.sin(2.0 * angle))
        attitude = tilt @ _rotations(across, 2.0 * angle)
        unit = attitude @ direction
        earth = attitude @ world.earth_t * (1.0 + np.einsum("...i,ij,...j", unit, strength, unit))[..., None]
        here = attitude @ gradient @ attitude.swapaxes(-1, -2) @ world.places[:, :, None]
        pressing = (touched & (times_s > 8.0) & (times_s < 9.0))[..., None]
        earth = earth * (1.0 + soft_iron * np.array([1.0, -1.0, 0.0]))
        return at_rest + world.sensed(earth + here[..., 0]) + pressing * press

    return turning_means(frames_of(fields, seconds, random, noise_t))


def pressing(world: World, count: int = 30, seconds: float = 40.0, robot_rad: float = 0.0) -> Means:
    """`count` presses anywhere, half a second each with rests between; the robot turns by `robot_rad` meanwhile."""
    random = world.random
    x_m, y_m = random.uniform(-10e-3, 10e-3, (2, count))
    force_n = random.uniform(0.2, 2.0, count)
    period_s = seconds / count

    def fields(times_s: np.ndarray) -> np.ndarray:
        flat = times_s.ravel()
        which = np.minimum(flat // period_s, count - 1).astype(int)
        within = flat % period_s / period_s
        force = force_n[which] * np.clip(np.minimum(within / 0.2, (0.8 - within) / 0.2), 0.0, 1.0)
        states = world.pressed(x_m[which], y_m[which], force)
        position = np.array([state.position_m for state in states])
        axis = np.array([state.axis for state in states])
        magnet = world.pad.magnet.with_remanence(world.remanence_t)
        sensor = np.tile(np.arange(4), len(times_s))
        own = cylinder_field(world.places[sensor], position, axis, magnet)
        earth = _rotations(np.array([1.0, 0.0, 0.0]), robot_rad * flat / seconds) @ world.earth_t
        return world.sensed((own + earth).reshape(len(times_s), 4, 3))

    return means(frames_of(fields, seconds, random))
