"""Solves the poses of many single frames at once, as a running pad's tracker would.

Scene "drifting" (a pad's default): the ambient field is free, and the moment is the baseline's: eight unknowns. Scene
"constant": the paper's six. A running tracker also uses the ambient field of earlier frames, which makes contacts a few
percent more certain. Models are trained on single frames, which need no history.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product
from fmfts.baseline import Mounting
from fmfts.pad import Array, Pad
from fmfts.pose import FREE_FIELD, FREE_PAPER, STOP_CONVERGED, Batch, State, parts_of, solve, tangent_basis
from fmfts.pose.change import shortest_rotation
from fmfts.pose.kernel import RESIDUAL, STATUS, predict
from fmfts.pose.problem import MAX_ITERATIONS, VALUE, magnet_rows, measurement_rows

Scene = Literal["drifting", "constant"]
UNKNOWNS = {"drifting": FREE_FIELD, "constant": FREE_PAPER}
STOP = 1e-6  # change of χ² at which the solver stops: noise-free poses are exact to 0.01 µm


class UnsolvedError(ValueError):
    """A field that no pose explains; `row` is the first of them."""

    def __init__(self, row: int) -> None:
        super().__init__(f"the solver finds no pose for frame {row}")
        self.row = row


@dataclass(frozen=True, slots=True)
class Tracked:
    """pose (K, 6): nominal rest + change, in mm and as a unit axis, as the contact model gets it. covariance (K, 5, 5):
    of its first five components. remanence_t (K,): estimated, or the baseline's. residual_t (K,): rms residual."""

    pose: Array
    covariance: Array
    remanence_t: Array
    residual_t: Array

    def __len__(self) -> int:
        return len(self.pose)

    def some(self, rows: NDArray[np.bool_]) -> Tracked:
        """The poses of the rows (K,) that are True."""
        return type(self)(self.pose[rows], self.covariance[rows], self.remanence_t[rows], self.residual_t[rows])

    @property
    def deviation(self) -> Array:
        """(K, 5) standard deviations."""
        deviation: Array = np.sqrt(np.einsum("kii->ki", self.covariance))
        return deviation


class FrameSolver:
    """Solves single frames of one pad, with white noise of `noise_t`.

    rest_field_t (N, 3): field of the unloaded pad without the ambient field, NaN at axes that its chips do not have;
    rest pose and moment are estimated from it. mounting: a baseline's, with rest pose, moment and the real places of
    the sensors; replaces them.
    """

    def __init__(
        self, pad: Pad, rest_field_t: Array, scene: Scene, noise_t: float, mounting: Mounting | None = None
    ) -> None:
        self.pad = pad
        self.scene = scene
        self.noise_t = noise_t
        self._nothing = np.where(np.isfinite(rest_field_t), 0.0, np.nan)
        self._geometry = pad if mounting is None else mounting.mounted(pad)
        self._rest = solve(rest_field_t, pad, stop_chi2=STOP_CONVERGED).state if mounting is None else mounting.rest
        self._turn = shortest_rotation(self._rest.axis, pad.rest_axis)

    @property
    def rest_pose(self) -> Array:
        """(6,) the drawing's rest pose, in mm and as a unit axis."""
        return np.concatenate([self.pad.rest_position_m * 1e3, self.pad.rest_axis])

    @property
    def remanence_t(self) -> float:
        """The remanence estimated from the unloaded pad."""
        return float(self._geometry.magnet.remanence_t * np.exp(self._rest.log_moment))

    def solved(self, field_t: Array, bound_t: Array | None = None) -> Tracked:
        """Poses of fields (K, N, 3) in sensor axes without the ambient field; NaN values are left out.

        bound_t (K, N, 3): where a value was clipped the end of its range, with its sign; else NaN. A pose that puts
        such a value inside of the range is solved again with the value at its end: the nearest that is possible. Raises
        UnsolvedError.
        """
        batch = self._within(field_t, bound_t)
        unsolved = np.flatnonzero(batch.summary[:, STATUS] != 0)
        if len(unsolved):
            raise UnsolvedError(int(unsolved[0]))
        return self._tracked(batch)

    def solved_if_possible(self, field_t: Array, bound_t: Array) -> Array:
        """(K, 6) poses as `solved`; NaN if a row's values do not determine one.

        A running pad with a force model calls it: without bounds its numbers are the same on every processor.
        """
        batch = self._within(field_t, bound_t)
        solved = batch.summary[:, STATUS] == 0
        pose: Array = np.where(solved[:, None], self._poses(batch), np.nan)
        return pose

    def _within(self, field_t: Array, bound_t: Array | None) -> Batch:
        batch = self._solved(field_t)
        if bound_t is None or not np.isfinite(bound_t).any():
            return batch
        inside = np.abs(self._predicted(batch.state)) < np.abs(bound_t)
        inside &= (batch.summary[:, STATUS] == 0)[:, None, None]
        return self._solved(np.where(inside, bound_t, field_t))

    def _predicted(self, state: Array) -> Array:
        """(K, N, 3): the predicted fields in the states (K, columns)."""
        sensors, magnet = self._geometry.sensors, magnet_rows(self._geometry.magnet)
        rows = measurement_rows(np.zeros((len(sensors), 3)), sensors, self.noise_t)
        each = [predict(rows, magnet, State.from_vector(one))[0] for one in state]
        return np.array(each).reshape(len(state), len(sensors), 3)

    def common_field_t(self, field_t: Array) -> Array:
        """(3,) median ambient field in the fields (K, N, 3), which was not subtracted.

        The scene "constant" does not estimate it: there it is zero, and the ambient field adds to the residual.
        """
        states = [State.from_vector(values) for values in self._solved(field_t).state]
        common: Array = np.median([state.ambient_t for state in states], axis=0)
        return common

    def at(self, pose: Array) -> Tracked:
        """The poses (K, 6) themselves, with the covariance that the solver gives for frames of them."""
        state = np.tile(self._rest.vector(), (len(pose), 1))
        state[:, :3] = pose[:, :3] * 1e-3 - self.pad.rest_position_m + self._rest.position_m
        state[:, 3:6] = pose[:, 3:] @ self._turn
        batch = self._batch(np.tile(self._nothing, (len(pose), 1, 1)), state)
        batch.solve(STOP, 0)
        return self._tracked(batch)

    def _solved(self, field_t: Array) -> Batch:
        batch = self._batch(field_t, np.tile(self._rest.vector(), (len(field_t), 1)))
        batch.solve(STOP, MAX_ITERATIONS)
        return batch

    def _batch(self, field_t: Array, start: Array) -> Batch:
        sensors, magnet = self._geometry.sensors, self._geometry.magnet
        one = measurement_rows(np.zeros((len(sensors), 3)), sensors, self.noise_t)
        rows = np.repeat(one[None], len(field_t), axis=0)
        rows[:, :, VALUE] = field_t.reshape(len(field_t), -1)
        return Batch.of(rows, magnet_rows(magnet), parts_of(free=UNKNOWNS[self.scene]), start)

    def _poses(self, batch: Batch) -> Array:
        position_m, axis = batch.state[:, :3], batch.state[:, 3:6]
        shifted = (self.pad.rest_position_m + position_m - self._rest.position_m) * 1e3
        return np.concatenate([shifted, product(axis, self._turn.T)], axis=1)

    def _tracked(self, batch: Batch) -> Tracked:
        axis = batch.state[:, 3:6]
        spread = np.zeros((len(axis), 5, 5))
        spread[:, :3, :3] = np.eye(3) * 1e3
        spread[:, 3:, 3:] = (self._turn @ np.array([tangent_basis(one) for one in axis]))[:, :2]
        return Tracked(
            self._poses(batch),
            spread @ batch.covariance[:, :5, :5] @ spread.transpose(0, 2, 1),
            self._geometry.magnet.remanence_t * np.exp(batch.state[:, 6]),
            batch.summary[:, RESIDUAL],
        )


def upright(pose: Array) -> Array:
    """Poses (K, 6) with p computed again from m and n, so that axes are unit vectors."""
    tilt = pose[:, 3:5]
    shrink = np.maximum(np.linalg.norm(tilt, axis=1, keepdims=True) / 0.999, 1.0)
    tilt = tilt / shrink
    return np.concatenate([pose[:, :3], tilt, np.sqrt(1.0 - (tilt**2).sum(axis=1, keepdims=True))], axis=1)
