"""Textbook Kalman filters without iteration: extended, and unscented.

They are written here because filterpy has had no release since 2018. Their settings are favourable: the moment is
known; a drifting ambient field is a random walk with the daemon's rate; the pose is a random walk as large as a fast
tap from frame to frame; a χ² gate on the innovation flags samples that do not fit.

R. E. Kalman's filter about the last estimate (extended), and S. J. Julier, J. K. Uhlmann, "Unscented filtering and
nonlinear estimation", Proc. IEEE 92 (2004) 401, with α = 1, β = 0, κ = 3 − n.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fmfts.pad import Array
from fmfts.pose import State, tangent_basis
from fmfts.pose.dipole import dipole_field
from fmfts.pose.kernel import predict
from fmfts.pose.problem import VALUE, magnet_rows, measurement_rows
from fmfts.pose.state import AMBIENT, AXIS, POSITION
from fmfts.scene.tracking import AMBIENT_DEVIATION_T, AMBIENT_WALK_T2_PER_S
from fmfts_lab.bench.speed import TAPPED_M, TAPPED_RAD
from fmfts_lab.study.kernels import misfits
from fmfts_lab.study.method import NOTHING, Answer
from fmfts_lab.study.world import Sample, World

FRAME_S = 1.0 / 220.0  # time in which a tap moves the magnet by TAPPED_M


class Updated(NamedTuple):
    state: State
    variance: Array
    chi2: float
    rows: int


class ExtendedKalman:
    """Estimates the pose and, if it drifts, the ambient field; linearises once around the prediction."""

    def __init__(self, world: World) -> None:
        self._drifts = world.config.scene.ambient == "drifting"
        self._columns = np.r_[(POSITION, AXIS, AMBIENT) if self._drifts else (POSITION, AXIS)]
        self._rows = measurement_rows(np.zeros((len(world.drawing.sensors), 3)), world.drawing.sensors, world.noise_t)
        self._magnets = magnet_rows(world.drawing.magnet)
        self._noise = world.noise_t**2
        pose = np.array([TAPPED_M] * 3 + [TAPPED_RAD] * 2) ** 2 / FRAME_S
        self._walk = np.r_[pose, [AMBIENT_WALK_T2_PER_S] * 3][: len(self._columns)]
        self.state = self._rest = world.rest
        self._start = np.diag(np.r_[pose * FRAME_S, [AMBIENT_DEVIATION_T**2] * 3][: len(self._columns)])
        self.covariance = self._start

    def ask(self, sample: Sample) -> Updated:
        self.covariance = self.covariance + np.diag(self._walk * sample.elapsed_s)
        self._rows[:, VALUE] = sample.field_t.ravel()
        updated, step, gained = self._update(np.isfinite(self._rows[:, VALUE]))
        if not misfits(updated.chi2, updated.rows):
            whole = np.zeros(self.state.columns)
            whole[self._columns] = step
            self.state, self.covariance = self.state.stepped(whole), gained
        return updated._replace(state=self.state, variance=np.diagonal(gained))

    def told(self, raw: Updated) -> Answer:
        if misfits(raw.chi2, raw.rows):
            return NOTHING
        return Answer(raw.state.position_m, raw.state.axis, np.sqrt(raw.variance[:3]), False)

    def _update(self, seen: Array) -> tuple[Updated, Array, Array]:
        predicted, jacobian = predict(self._rows, self._magnets, self.state)
        slope = jacobian[np.ix_(seen, self._columns)]
        innovation = self._rows[seen, VALUE] - predicted[seen]
        cross = self.covariance @ slope.T
        return self._gained(innovation, slope @ cross, cross)

    def _gained(self, innovation: Array, spread: Array, cross: Array) -> tuple[Updated, Array, Array]:
        """The step and the new covariance from an innovation with covariance `spread` + noise, and covariance `cross`
        with the state."""
        spread = spread + self._noise * np.eye(len(innovation))
        gain = np.linalg.solve(spread, cross.T).T
        chi2 = float(innovation @ np.linalg.solve(spread, innovation)) if len(innovation) else np.inf
        after = self.covariance - gain @ cross.T
        return Updated(self.state, np.diagonal(after), chi2, max(len(innovation), 1)), gain @ innovation, after


class UnscentedKalman(ExtendedKalman):
    """The same state, with 2n + 1 points instead of a derivative."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._place = world.drawing.sensors.position_m
        self._rotation = world.drawing.sensors.axes
        self._magnet = world.drawing.magnet.strength_t_m3, world.drawing.magnet.modelled_octupole_m2

    def _update(self, seen: Array) -> tuple[Updated, Array, Array]:
        size = len(self._columns)
        half = np.linalg.cholesky(3.0 * self.covariance).T
        points = np.concatenate([np.zeros((1, size)), half, -half])
        weight = np.r_[1.0 - size / 3.0, np.full(2 * size, 1.0 / 6.0)]
        fields = self._fields(points)[:, seen]
        mean = weight @ fields
        away = fields - mean
        return self._gained(self._rows[seen, VALUE] - mean, (away.T * weight) @ away, (points.T * weight) @ away)

    def _fields(self, points: Array) -> Array:
        """(2n + 1, 3N) readings of the states that are `points` away from the mean."""
        position = self.state.position_m + points[:, :3]
        axis = self.state.axis + points[:, 3:5] @ tangent_basis(self.state.axis).T
        axis /= np.linalg.norm(axis, axis=1)[:, None]
        ambient = self.state.ambient_t + (points[:, 5:8] if self._drifts else 0.0)
        fields = np.stack(
            [dipole_field(self._place, *pose, *self._magnet) for pose in zip(position, axis, strict=True)]
        )
        fields = fields + np.broadcast_to(ambient, (len(points), 3))[:, None]
        readings: Array = np.einsum("nji,knj->kni", self._rotation, fields).reshape(len(points), -1)
        return readings
