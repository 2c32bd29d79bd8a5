"""The most probable geometry from one start: the magnet's pose in each press is eliminated (variable projection).

Each press has five unknowns of its own, and all share the geometry: the normal matrix has the shape of an arrow. The
residuals are those after each press's best pose, which the product's own solver finds; their derivative by the geometry
is what is perpendicular to the derivatives by that pose (Kaufman, BIT 15, 1975). SciPy solves for the geometry alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fmfts.pose import FREE_POSE, State, parts_of
from fmfts.pose.kernel import CHI2, Batch
from fmfts.pose.problem import DIRECTION, MEASUREMENT, NOISE, PLACE, STOP_CONVERGED, VALUE
from fmfts.pose.state import POSITION, SIZE, VALUES
from fmfts_calibrate.learn.drawing import REST, Drawing, Geometry

Array = NDArray[np.float64]

ROBUST = 3.0
POSE_ITERATIONS = 40
FAR = 0.15  # share of the way to the nearest sensor


@dataclass(frozen=True, slots=True)
class Fields:
    """rest_t (N, 3), the magnet's field untouched, and press_t (K, N, 3), under presses, as the chips report them.

    A NaN is left out alone: an axis that a chip does not have, or a value that was clipped. rest_deviation_t,
    deviation_t (N, 3).
    """

    rest_t: Array
    press_t: Array
    rest_deviation_t: Array
    deviation_t: Array

    def only(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Fields:
        return Fields(self.rest_t, self.press_t[which], self.rest_deviation_t, self.deviation_t)


@dataclass(frozen=True, slots=True)
class Fit:
    """vector (M,) and its information (M, M), the drawing's included. poses: state vectors (K, 15) of the presses.

    chi2: of everything, the prior included. residual (K, 3N): of the presses, in deviations; 0 where left out.
    """

    vector: Array
    information: Array
    poses: Array
    chi2: float
    residual: Array
    settled: bool


@dataclass
class Bundle:
    """Residuals and their derivative for `scipy.optimize.least_squares`."""

    drawing: Drawing
    fields: Fields
    poses: Array | None = None
    _at: Array | None = field(default=None, init=False)

    def fit(self, start: Array, most: int, robust: bool = False) -> Fit:
        """The fit after at most this many evaluations. robust: residuals beyond ROBUST deviations count less
        (Huber).
        """
        from scipy.optimize import least_squares

        loss = {"loss": "huber", "f_scale": ROBUST} if robust else {}
        found = least_squares(self.residual, start, self.jacobian, ftol=1e-7, xtol=1e-7, max_nfev=most, **loss)
        left = self.residual(found.x)
        slope = self.jacobian(found.x)
        rows = self.fields.press_t[0].size
        presses = left[rows : rows * (1 + len(self.fields.press_t))].reshape(-1, rows)
        assert self.poses is not None
        return Fit(found.x, slope.T @ slope, self.poses.copy(), float(left @ left), presses, found.status > 0)

    def residual(self, vector: Array) -> Array:
        """The residuals at rest (3N,), of the presses (3N each), and of the drawing (M,), in deviations."""
        self._evaluate(vector)
        return self._residual

    def jacobian(self, vector: Array) -> Array:
        self._evaluate(vector)
        return self._jacobian

    def _evaluate(self, vector: Array) -> None:
        if self._at is not None and np.array_equal(vector, self._at):
            return
        geometry, fields = self.drawing.geometry(vector), self.fields
        self.poses = solved_poses(geometry, self.drawing, fields, self.poses)
        predicted, _, shared = self.drawing.derivatives(geometry, geometry.rest)
        weight, at_rest = weighted(fields.rest_t, fields.rest_deviation_t, predicted)
        slope_at_rest = -weight[:, None] * shared
        predicted, own, shared = self.drawing.derivatives_of(geometry, states_of(geometry, self.poses))
        weight, left = weighted(fields.press_t, fields.deviation_t, predicted)
        shared[..., REST] = 0.0
        seen = np.concatenate([left[..., None], -weight[..., None] * shared], axis=2)
        both = projected(weight[..., None] * own, seen).reshape(-1, 1 + len(vector))
        fixed = self.drawing.deviation == 0.0
        self._residual = np.concatenate([at_rest, both[:, 0], vector])
        self._jacobian = np.concatenate([slope_at_rest, both[:, 1:], np.eye(len(vector))])
        self._jacobian[: -len(vector), fixed] = 0.0
        self._at = vector.copy()


AXIS_VALUES = slice(3, 6)  # places of the axis in a state's vector; a step has two columns for it


def states_of(geometry: Geometry, poses: Array) -> list[State]:
    """The states of state vectors (K, 15)."""
    return [geometry.at(pose[POSITION], pose[AXIS_VALUES]) for pose in poses]


def weighted(field_t: Array, deviation_t: Array, predicted: Array) -> tuple[Array, Array]:
    """One over the deviation (…, 3N), 0 where the value is not there; and the misfit (…, 3N) in deviations.

    field_t (…, N, 3), deviation_t (N, 3), predicted (…, 3N).
    """
    fields = field_t.reshape(predicted.shape)
    there = np.isfinite(fields)
    weight = np.where(there, 1.0 / deviation_t.ravel(), 0.0)
    return weight, weight * (np.where(there, fields, predicted) - predicted)


def projected(own: Array, seen: Array) -> Array:
    """The part of the columns `seen` (…, R, C) that is perpendicular to the columns `own` (…, R, 5)."""
    basis, _ = np.linalg.qr(own)
    return np.asarray(seen - basis @ (basis.swapaxes(-1, -2) @ seen))


def misfits(drawing: Drawing, vector: Array, fields: Fields) -> tuple[Array, NDArray[np.intp]]:
    """Residuals (K, 3N) of presses with a given geometry, in deviations, and the degrees of freedom (K,)."""
    geometry = drawing.geometry(vector)
    poses = solved_poses(geometry, drawing, fields)
    predicted, _, _ = drawing.derivatives_of(geometry, states_of(geometry, poses))
    _, left = weighted(fields.press_t, fields.deviation_t, predicted)
    there = np.isfinite(fields.press_t).reshape(len(fields.press_t), -1).sum(axis=1)
    return left, there - 5


def solved_poses(geometry: Geometry, drawing: Drawing, fields: Fields, before: Array | None = None) -> Array:
    """State vectors (K, 15) of the presses by the running pad's solver, from the poses `before`; None: cold."""
    count = len(fields.press_t)
    chips = geometry.reported()
    rows = chips.axes.transpose(0, 2, 1)
    size = np.linalg.norm(rows, axis=2)
    measured = np.empty((count, len(chips), 3, MEASUREMENT))
    measured[..., PLACE] = chips.position_m[:, None]
    measured[..., DIRECTION] = rows / size[:, :, None]
    measured[..., VALUE] = fields.press_t / size
    measured[..., NOISE] = fields.deviation_t / size
    measured[..., NOISE + 1 :] = 0.0
    rest = geometry.rest.vector()
    best, least = np.tile(rest, (count, 1)), np.full(count, np.inf)
    if before is not None:
        best[:] = _with_moment(before, rest)
    magnets = np.array([[drawing.pad.magnet.strength_t_m3, geometry.octupole_m2]])
    for start in _cold_starts(best, geometry) if before is None else [_with_moment(before, rest)]:
        batch = Batch.of(measured.reshape(count, -1, MEASUREMENT), magnets, parts_of(SIZE, free=FREE_POSE), start)
        batch.solve(STOP_CONVERGED, POSE_ITERATIONS)
        chi2 = np.nan_to_num(batch.summary[:, CHI2], nan=np.inf)
        better = (chi2 < least) & np.isfinite(batch.state).all(axis=1)
        best[better], least[better] = batch.state[better], chi2[better]
    return best


def _cold_starts(at_rest: Array, geometry: Geometry) -> list[Array]:
    """State vectors (K, 15) at rest, and moved to each side and down by a part of the way to the nearest sensor: large
    displacements have wrong minima."""
    away = float(np.linalg.norm(geometry.sensors.position_m - geometry.rest.position_m, axis=1).min())
    starts = [at_rest]
    for sideways in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        moved = at_rest.copy()
        moved[:, POSITION] += FAR * away * np.array([*sideways, -1.0])
        starts.append(moved)
    return starts


def _with_moment(poses: Array, rest: Array) -> Array:
    moved = poses.copy()
    moved[:, 6:VALUES] = rest[6:VALUES]
    return moved
