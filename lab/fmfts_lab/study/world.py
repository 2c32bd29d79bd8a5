"""The simulated world in which all methods are measured: samples of one pad with known pose and press, and faults."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fmfts.baseline import Baseline
from fmfts.baseline.request import BaselineRequest
from fmfts.config import PadConfig, SceneConfig, ToleranceConfig
from fmfts.pad import Array, Pad, rotation_from_vector
from fmfts.pose import State
from fmfts.sensor import Frame
from fmfts.sensor.chips import NOISE_T, TESLA_PER_GAUSS
from fmfts.sensor.frame import WireFrame
from fmfts_simulation.chip import as_counts
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.mounted import EARTH_T, MountedPad, with_chips_turned
from fmfts_simulation.source import TURNING_AXIS

Counts = NDArray[np.int16]

BASELINE_S = 1.0
REST_S = 0.1  # before the first press
EARTH = EARTH_T * np.array([0.6, -0.64, 0.48])


class Path(NamedTuple):
    """The magnet's path over K frames: time_s (K,), position_m (K, 3), axis (K, 3), press (K, 3): x, y in mm and force
    in N, NaN for poses that no press causes."""

    time_s: Array
    position_m: Array
    axis: Array
    press: Array


# Path and built pad → foreign field (K, N, 3) at the sensors, in pad axes.
Foreign = Callable[[Path, MountedPad], Array]
# Counts (K, N, 3) of the chips → counts as they arrive; the chip's saturated count for a missing one.
Broken = Callable[[Counts], Counts]


class Sample(NamedTuple):
    """field_t (N, 3): the ambient field is subtracted as exactly as possible; NaN if nothing was measured. elapsed_s:
    since the sample before. frame: the same sample in the form that the daemon gets."""

    field_t: Array
    elapsed_s: float
    frame: Frame


@dataclass(frozen=True, slots=True)
class World:
    """The pad as it really is. drawing: what all methods know of it; config: what only the daemon knows besides.

    noise_t: white noise of a sample. After the baseline is recorded, the robot turns with turning_rad_per_s, the faults
    foreign and broken act, and the magnet warms by warming_k_per_s, which the thermometer shows.
    """

    config: PadConfig
    drawing: Pad
    built: MountedPad
    rate_hz: float = 220.0
    noise_t: float = NOISE_T
    turning_rad_per_s: float = 0.0
    foreign: tuple[Foreign, ...] = ()
    broken: Broken | None = None
    warming_k_per_s: float = 0.0
    range_gauss: float = 2.5

    @property
    def rest(self) -> State:
        return State.at_rest(self.drawing)

    def samples(self, path: Path, random: np.random.Generator) -> list[Sample]:
        """The chips' samples along `path`, at its times."""
        counts = self.counts(self._field(path), random)
        if self.broken is not None:
            counts = self.broken(counts)
        ambient = self.built.sensed(np.tile(self.built.ambient_t, (len(self.drawing.sensors), 1)))
        elapsed = np.diff(path.time_s, prepend=path.time_s[0] - 1.0 / self.rate_hz)
        warming = self.warming_k_per_s * path.time_s
        frames = self._frames(counts, path.time_s + BASELINE_S, warming)
        return [
            Sample(frame.field_t - ambient, gap, frame) for frame, gap in zip(frames, elapsed.tolist(), strict=True)
        ]

    def baseline(self, random: np.random.Generator) -> Baseline:
        """The baseline, bare and at rest, recorded before anything went wrong."""
        time_s = np.arange(0.0, BASELINE_S, 1.0 / self.rate_hz)
        ambient = np.tile(self.built.ambient_t, (len(time_s), len(self.drawing.sensors), 1))
        own = self._magnet_field(resting(self.built, time_s), np.zeros(len(time_s)))
        before: Baseline | None = None
        for is_bare, fields in ((True, ambient), (False, ambient + own)):
            counts = self.counts(self.built.sensed(fields), random)
            request = BaselineRequest(self.drawing, self.config.tolerance.si(), bare=is_bare, replaced=False)
            before, _ = request.make(list(self._frames(counts, time_s, np.zeros(len(time_s)))), before)
        assert before is not None
        return before

    def counts(self, field_t: Array, random: np.random.Generator) -> Counts:
        """The counts of fields in sensor axes, with noise; the saturated count beyond the range."""
        noisy = field_t + random.normal(0.0, self.noise_t, field_t.shape)
        chip = self.drawing.chip
        return as_counts(chip, noisy * (np.array(chip.counts_per_gauss[self._gain_code]) / TESLA_PER_GAUSS))

    @property
    def _gain_code(self) -> int:
        return self.drawing.chip.gain_code_for_range(self.range_gauss)

    def _field(self, path: Path) -> Array:
        field_t = self._magnet_field(path, self.warming_k_per_s * path.time_s)
        angles = self.turning_rad_per_s * path.time_s
        turned = np.array([rotation_from_vector(TURNING_AXIS * angle) @ self.built.ambient_t for angle in angles])
        field_t += turned[:, None]
        for foreign in self.foreign:
            field_t += foreign(path, self.built)
        return self.built.sensed(field_t)

    def _magnet_field(self, path: Path, warming_k: Array) -> Array:
        pad = self.built.pad
        field_t = cylinder_field(pad.sensors.position_m, path.position_m[:, None], path.axis[:, None], pad.magnet)
        field_t *= (1.0 + self.config.magnet.temperature_coefficient_per_k * warming_k)[:, None, None]
        return field_t

    def _frames(self, counts: Counts, time_s: Array, warming_k: Array) -> Iterator[Frame]:
        shape, chip = counts.shape[1], self.drawing.chip
        for number, (one, now_s, warmer_k) in enumerate(zip(counts, time_s.tolist(), warming_k.tolist(), strict=True)):
            answered, ages = np.ones(shape, dtype=np.bool_), np.zeros(shape, dtype=np.uint16)
            times = round(now_s * 1e6), round(now_s * 1e9)
            frame = Frame(0, number, *times, self._gain_code, one, ages, answered, answered, 25.0 + warmer_k, chip=chip)
            # The frame in the form that a bridge delivers.
            yield WireFrame(0, number, *times, frame.packed, frame.temperature_c, chip=chip)


def drawn_world(config: PadConfig, turning_deg_per_s: float = 0.0) -> World:
    """The pad exactly as drawn, in the Earth's field, gains known to ±0.5 % as after a self-test."""
    drawing, exact = config.pad(), MountedPad.exact(config.pad())
    built = MountedPad(exact.pad, exact.gain, EARTH, exact.rest_axis_from_z)
    return World(_tested(config), drawing, built, turning_rad_per_s=float(np.deg2rad(turning_deg_per_s)))


def built_world(config: PadConfig, seed: int, turning_deg_per_s: float = 0.0) -> World:
    """A pad with random errors of manufacture within the tolerances; no method knows them."""
    random = np.random.default_rng([seed, 11])
    built = MountedPad.built(config.pad(), random, errors=with_chips_turned(0.0, 0.0))
    return World(_tested(config), config.pad(), built, turning_rad_per_s=float(np.deg2rad(turning_deg_per_s)))


def _tested(config: PadConfig) -> PadConfig:
    return msgspec.structs.replace(
        config, tolerance=ToleranceConfig(gain=0.005, sensor_rotation_deg=0.0, cross_axis=0.0)
    )


def in_scene(config: PadConfig, scene: SceneConfig) -> PadConfig:
    return msgspec.structs.replace(config, scene=scene)


def resting(built: MountedPad, time_s: Array) -> Path:
    return pressed(built, time_s, np.zeros((len(time_s), 3)))


def pressed(built: MountedPad, time_s: Array, press: Array) -> Path:
    """The path under presses (K, 3): x, y in mm, force in N."""
    position_m, axis = built.pose(press[:, 0] * 1e-3, press[:, 1] * 1e-3, press[:, 2])
    return Path(time_s, position_m, axis, press)


def frame_times(seconds: float, rate_hz: float) -> Array:
    return np.arange(round(seconds * rate_hz)) / rate_hz


def presses(
    time_s: Array,
    random: np.random.Generator,
    *,
    reach_mm: float = 8.0,
    press_s: float = 0.5,
    force_n: tuple[float, float] = (0.3, 1.9),
) -> Array:
    """(K, 3) presses at times (K,): one after another, each of `press_s`, anywhere within `reach_mm`."""
    count = int(time_s[-1] / press_s) + 2
    radius = reach_mm * np.sqrt(random.uniform(0.0, 1.0, count))
    angle = random.uniform(0.0, 2.0 * np.pi, count)
    places = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    hardest = random.uniform(*force_n, count)
    which, within = np.divmod(np.maximum(time_s - REST_S, 0.0) / press_s, 1.0)
    which = which.astype(np.intp)
    force = hardest[which] * 0.5 * (1.0 - np.cos(2.0 * np.pi * within))
    return np.column_stack([places[which], force])
