"""Labelled poses to train and to judge on: simulated presses, seen through this project's own solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from fmfts.pad import Array, Magnet, Pad
from fmfts.pose import STOP_CONVERGED, PoseEstimate, State, solve
from fmfts.simulate.chip import NOISE_T
from fmfts.simulate.cylinder import cylinder_field
from fmfts.simulate.mechanics import standard_mechanics


@dataclass(frozen=True, slots=True)
class Samples:
    """K presses and what the solver makes of each.

    x_m, y_m, force_n: (K,). pose: (K, 6) position in mm and unit axis, relative to rest as the pipeline hands it to
    the model: nominal rest + (solved − solved at rest), so that the dipole's bias at rest cancels.
    covariance: (K, 5, 5) of pose's first five components, for the noise of one frame.
    """

    x_m: Array
    y_m: Array
    force_n: Array
    pose: Array
    covariance: Array

    @classmethod
    def solved(cls, pad: Pad, press: tuple[Array, Array, Array], field_t: Array, start: Array | None = None) -> Self:
        """Of `field_t` (K, n, 3). `start` (K, 6): poses in m to start the search from, rest if None."""
        rest = _field_at_rest(pad, pad.magnet)
        rest_shift_m = solve(rest, pad, stop_chi2=STOP_CONVERGED).position_m - pad.rest_position_m
        pose, covariance = np.empty((len(field_t), 6)), np.empty((len(field_t), 5, 5))
        for row, field in enumerate(field_t):
            origin = None if start is None else State(start[row, :3], start[row, 3:], 0.0, np.zeros(3))
            estimate: PoseEstimate = solve(field, pad, origin, deviation_t=NOISE_T)
            pose[row] = [*(estimate.position_m - rest_shift_m) * 1e3, *estimate.axis]
            millimetres = np.array([1e3, 1e3, 1e3, 1.0, 1.0])
            covariance[row] = estimate.pose_covariance[:5, :5] * millimetres * millimetres[:, None]
        if not np.isfinite(covariance).all():
            raise ValueError(f"pad {pad.name!r}: the solver found no pose for a simulated press")
        return cls(*press, pose, covariance)

    @classmethod
    def drawn(
        cls,
        pad: Pad,
        count: int,
        largest_force_n: float,
        seed: int,
        *,
        noise_t: float = 0.0,
        magnet: Magnet | None = None,
    ) -> Self:
        """Presses spread evenly over ±14 mm and 0…`largest_force_n`; `magnet` if the pad holds another than nominal."""
        random = np.random.default_rng(seed)
        x_m, y_m = random.uniform(-14e-3, 14e-3, (2, count))
        force_n = random.uniform(0.0, largest_force_n, count)
        return cls.pressed(pad, (x_m, y_m, force_n), random, noise_t, magnet or pad.magnet)

    @classmethod
    def pressed(
        cls, pad: Pad, press: tuple[Array, Array, Array], random: np.random.Generator, noise_t: float, magnet: Magnet
    ) -> Self:
        displacement_m, axis = standard_mechanics().displacement(*press)
        position_m = pad.rest_position_m + displacement_m
        field_t = cylinder_field(pad.sensors.position_m, position_m[:, None], axis[:, None], magnet)
        noisy = field_t + noise_t * random.standard_normal(field_t.shape)
        return cls.solved(pad, press, noisy, np.concatenate([position_m, axis], axis=1))

    def repeated(self, copies: int, random: np.random.Generator) -> Self:
        """Each press `copies` times with fresh noise, drawn from the pose's covariance: no solving anew."""
        root = np.repeat(np.linalg.cholesky(self.covariance), copies, axis=0)
        pose = np.repeat(self.pose, copies, axis=0)
        pose[:, :5] += np.einsum("kij,kj->ki", root, random.standard_normal((len(pose), 5)))
        x_m, y_m, force_n = (np.repeat(values, copies) for values in (self.x_m, self.y_m, self.force_n))
        return type(self)(x_m, y_m, force_n, pose, np.repeat(self.covariance, copies, axis=0))

    def bound(self) -> Array:
        """(K, 3) Cramér–Rao bound of x (mm), y (mm) and force (N): standard deviations of one frame's best estimate."""
        place, push = 1e-5, 1e-3
        steps = [(place, 0.0, 0.0), (0.0, place, 0.0), (0.0, 0.0, push)]
        slopes = [self._moved(*step) - self._moved(*(-value for value in step)) for step in steps]
        slope = np.stack(slopes, axis=-1) / [2e3 * place, 2e3 * place, 2.0 * push]
        information = np.einsum("kai,kab,kbj->kij", slope, np.linalg.inv(self.covariance), slope)
        # At rest the place has no effect; an information of one per (1 m)² keeps the inverse finite.
        deviation: Array = np.sqrt(np.diagonal(np.linalg.inv(information + 1e-6 * np.eye(3)), axis1=1, axis2=2))
        return deviation

    def _moved(self, x_m: float, y_m: float, force_n: float) -> Array:
        displacement_m, axis = standard_mechanics().displacement(self.x_m + x_m, self.y_m + y_m, self.force_n + force_n)
        return np.concatenate([displacement_m * 1e3, axis[:, :2]], axis=1)


def _field_at_rest(pad: Pad, magnet: Magnet) -> Array:
    return cylinder_field(pad.sensors.position_m, pad.rest_position_m, pad.rest_axis, magnet)
