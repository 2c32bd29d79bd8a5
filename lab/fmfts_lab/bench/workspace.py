"""The pad and the poses of all benchmarks: the paper's geometry, with the data sheet's noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Pad
from fmfts.pose import FREE_FIELD, FREE_PAPER, FREE_POSE, Batch, State, parts_of
from fmfts.pose.problem import VALUE, magnet_rows, measurement_rows
from fmfts.sensor.chips import NOISE_T
from fmfts_simulation.cylinder import cylinder_field

Array = NDArray[np.float64]

MODELS = {5: FREE_POSE, 6: FREE_PAPER, 8: FREE_FIELD}


@dataclass(frozen=True, slots=True)
class Poses:
    """position_m (K, 3), axis (K, 3), ambient_t (K, 3)."""

    position_m: Array
    axis: Array
    ambient_t: Array

    def states(self) -> Array:
        """(K, 15) values of `State.vector`."""
        values = np.zeros((len(self.position_m), 15))
        values[:, 0:3], values[:, 3:6], values[:, 7:10] = self.position_m, self.axis, self.ambient_t
        return values

    def state(self, index: int) -> State:
        return State(self.position_m[index], self.axis[index], 0.0, self.ambient_t[index])


def standard_pad() -> Pad:
    return PadConfig(name="standard", source=SimulatedSource()).pad()


def in_workspace(count: int, random: np.random.Generator) -> Poses:
    """The range of a pad's magnet: ±1 mm sideways, 9–12.5 mm high, tilted up to 45°."""
    position = random.uniform([-1e-3, -1e-3, 9e-3], [1e-3, 1e-3, 12.5e-3], (count, 3))
    tilt, azimuth = random.uniform(0.0, np.pi / 4, count), random.uniform(0.0, 2 * np.pi, count)
    axis = np.stack([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)], axis=1)
    return Poses(position, axis, np.zeros((count, 3)))


def anywhere(count: int, random: np.random.Generator, ambient_t: float) -> Poses:
    """Poses in twice that range, with any axis, and an ambient field of up to `ambient_t` in each direction."""
    position = random.uniform([-2e-3, -2e-3, 7.25e-3], [2e-3, 2e-3, 14.25e-3], (count, 3))
    axis = random.normal(size=(count, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    return Poses(position, axis, random.uniform(-ambient_t, ambient_t, (count, 3)))


def displaced(poses: Poses, metres: float, radians: float, random: np.random.Generator) -> Array:
    """(K, 15) states displaced at random by these deviations in each direction, with the same ambient field."""
    values = poses.states()
    values[:, 0:3] += random.normal(0.0, metres, (len(values), 3))
    values[:, 3:6] += random.normal(0.0, radians, (len(values), 3))
    values[:, 3:6] /= np.linalg.norm(values[:, 3:6], axis=1)[:, None]
    return values


def readings(poses: Poses, pad: Pad, random: np.random.Generator, noise_t: float = NOISE_T) -> Array:
    """(K, 3N, 10) measurements of the exact cylinder's field, with noise."""
    count = len(poses.position_m)
    field = cylinder_field(pad.sensors.position_m, poses.position_m[:, None], poses.axis[:, None], pad.magnet)
    field = pad.sensors.to_sensor(field + poses.ambient_t[:, None])
    rows = np.repeat(measurement_rows(np.zeros((len(pad.sensors), 3)), pad.sensors, noise_t)[None], count, axis=0)
    rows[:, :, VALUE] = field.reshape(count, -1) + random.normal(0.0, noise_t, rows.shape[:2])
    return rows


def batch_of(rows: Array, pad: Pad, unknowns: int, octupole: bool, start: Array) -> Batch:
    return Batch.of(rows, magnet_rows(pad.magnet, octupole=octupole), parts_of(free=MODELS[unknowns]), start)
