"""The reference solver: Levenberg–Marquardt on the dipole model, written to be read beside the equations."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Pad
from fmfts.pose.dipole import IDENTITY, dipole_derivatives
from fmfts.pose.state import AMBIENT, AXIS, LOG_MOMENT, POSITION, SIZE, State, tangent_basis

Array = NDArray[np.float64]

FREE_POSE = np.arange(5)  # the moment is known
FREE_PAPER = np.arange(6)  # the paper's six unknowns: position, and a moment of free direction and length
FREE_FIELD = np.array([0, 1, 2, 3, 4, 6, 7, 8])  # the moment is known, the ambient field is not

# One step further would lower χ² by less than this: a thirtieth of a standard deviation is left to gain.
STOP_CHI2 = 1e-3
# Reached by steps that are rounding: for comparisons between solvers, not for frames.
STOP_CONVERGED = 1e-16
MAX_ITERATIONS = 50
FIRST_DAMPING = 1e-4
ROUNDING = 1e-12  # relative error of a sum of squares
TINY = 1e-300
# Smallest eigenvalue of the scaled normal matrix, relative to the largest, that double precision still resolves.
SINGULAR = 1e-12


class Status(StrEnum):
    CONVERGED = "converged"
    AT_LIMIT = "at limit"
    UNOBSERVABLE = "unobservable"
    INVALID = "invalid input"


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """What a field says of the magnet.

    covariance: (9, 9) of a step from `state` (see fmfts.pose.state), zero where an unknown was fixed; all NaN unless
    the status is CONVERGED or AT_LIMIT. chi2: sum of squared residuals in deviations over `rows` measurements.
    residual_t: root mean square of the residuals, tesla. remanence_t: the length of the moment as remanence.
    """

    state: State
    covariance: Array
    remanence_t: float
    chi2: float
    rows: int
    unknowns: int
    residual_t: float
    iterations: int
    status: Status

    @property
    def position_m(self) -> Array:
        return self.state.position_m

    @property
    def axis(self) -> Array:
        return self.state.axis

    @property
    def degrees_of_freedom(self) -> int:
        return self.rows - self.unknowns

    @property
    def pose_covariance(self) -> Array:
        """(6, 6) covariance of (position_m, axis): what the contact model needs; the axis part has rank two."""
        spread = np.zeros((6, 5))
        spread[:3, :3] = np.eye(3)
        spread[3:, 3:] = tangent_basis(self.state.axis)
        covariance: Array = spread @ self.covariance[:5, :5] @ spread.T
        return covariance


def solve(
    field_t: Array,
    pad: Pad,
    start: State | None = None,
    *,
    deviation_t: Array | float = 2e-7,
    free: NDArray[np.intp] = FREE_PAPER,
    stop_chi2: float = STOP_CHI2,
) -> PoseEstimate:
    """The magnet's state from one field.

    field_t: (N, 3) in each sensor's own axes, ambient subtracted; NaN where an axis holds no measurement (left out).
    deviation_t: (N, 3) or one number, standard deviation of each; infinite: left out; zero, negative or NaN: INVALID.
    start: the rest pose if None. free: the columns of the step that are unknown; the others keep the start's value.
    stop_chi2: see STOP_CHI2, STOP_CONVERGED.

    With the default unknowns and equal deviations this is the paper's method: twelve differences (the three sums that
    Eq. 8 literally writes would leave six unknowns with three equations), minimised from the rest pose (Eq. 9–10).
    """
    state = State.at_rest(pad) if start is None else start
    deviation = np.broadcast_to(deviation_t, field_t.shape)
    usable = np.isfinite(field_t) & (deviation != np.inf)
    if not (deviation[usable] > 0.0).all():
        return _failed(state, pad, usable, free, Status.INVALID)
    weight = np.zeros(field_t.shape)
    weight[usable] = 1.0 / deviation[usable]
    if usable.sum() < len(free):
        return _failed(state, pad, usable, free, Status.UNOBSERVABLE)
    field = np.where(usable, field_t, 0.0)
    damping, iterations, status = FIRST_DAMPING, 0, Status.AT_LIMIT
    residual, jacobian = _linearise(field, weight, pad, state, free)
    chi2 = float(residual @ residual)
    while iterations < MAX_ITERATIONS:
        step, promised = _damped_step(residual, jacobian, damping)
        move = np.zeros(SIZE)
        move[free] = step
        tried = state.stepped(move)
        if promised <= stop_chi2 and damping <= FIRST_DAMPING:
            # What is left to gain is not worth another look at the model: take the step and leave.
            state, status = tried, Status.CONVERGED
            break
        iterations += 1
        tried_residual, tried_jacobian = _linearise(field, weight, pad, tried, free)
        tried_chi2 = float(tried_residual @ tried_residual)
        if tried_chi2 <= chi2 * (1.0 + ROUNDING):
            state, residual, jacobian, chi2 = tried, tried_residual, tried_jacobian, tried_chi2
            damping *= 0.1
        else:
            damping *= 10.0
    covariance = _covariance(jacobian, free)
    if covariance is None:
        return _failed(state, pad, usable, free, Status.UNOBSERVABLE)
    raw = residual[usable.ravel()] / weight[usable]
    return PoseEstimate(
        state=state,
        covariance=covariance,
        remanence_t=pad.magnet.remanence_t * float(np.exp(state.log_moment)),
        chi2=chi2,
        rows=int(usable.sum()),
        unknowns=len(free),
        residual_t=float(np.sqrt(np.mean(raw * raw))),
        iterations=iterations,
        status=status,
    )


def _damped_step(residual: Array, jacobian: Array, damping: float) -> tuple[Array, float]:
    """Marquardt's step, and the decrease of χ² that the linear model promises for it."""
    normal, gradient = jacobian.T @ jacobian, jacobian.T @ residual
    scale = np.sqrt(np.maximum(np.diagonal(normal), TINY))
    scaled, slope = normal / (scale[:, None] * scale), gradient / scale
    scaled.flat[:: len(scale) + 1] += damping
    step = np.linalg.solve(scaled, slope)
    return step / scale, float(step @ (slope + damping * step))


def _linearise(field: Array, weight: Array, pad: Pad, state: State, free: NDArray[np.intp]) -> tuple[Array, Array]:
    """Residuals (3N,) and Jacobian (3N, len(free)) in deviations; the Jacobian is that of the prediction."""
    strength = pad.magnet.strength_t_m3 * np.exp(state.log_moment)
    dipole, by_position, by_axis = dipole_derivatives(pad.sensors.position_m, state.position_m, state.axis, strength)
    columns = np.empty((len(field), 3, SIZE))
    columns[:, :, POSITION] = by_position
    columns[:, :, AXIS] = by_axis @ tangent_basis(state.axis)
    columns[:, :, LOG_MOMENT] = dipole
    columns[:, :, AMBIENT] = IDENTITY
    to_sensor = pad.sensors.rotation.transpose(0, 2, 1)
    predicted = (to_sensor @ (dipole + state.ambient_t)[:, :, None])[:, :, 0]
    residual = (weight * (field - predicted)).ravel()
    jacobian = (weight[:, :, None] * (to_sensor @ columns)).reshape(-1, SIZE)[:, free]
    return residual, jacobian


def _covariance(jacobian: Array, free: NDArray[np.intp]) -> Array | None:
    """(9, 9) inverse of the undamped normal matrix, None where it has a direction that nothing measures."""
    normal = jacobian.T @ jacobian
    scale = np.sqrt(np.diagonal(normal))
    if not (scale > 0.0).all():
        return None
    values, vectors = np.linalg.eigh(normal / (scale[:, None] * scale))
    if values[0] < SINGULAR * values[-1]:
        return None
    half = vectors / np.sqrt(values) / scale[:, None]
    covariance = np.zeros((SIZE, SIZE))
    covariance[np.ix_(free, free)] = half @ half.T
    return covariance


def _failed(state: State, pad: Pad, usable: NDArray[np.bool_], free: NDArray[np.intp], status: Status) -> PoseEstimate:
    """An answer that cannot be mistaken for one: the state is where the search stood, everything else is NaN."""
    nan = float("nan")
    covariance = np.full((SIZE, SIZE), nan)
    return PoseEstimate(state, covariance, nan, nan, int(usable.sum()), len(free), nan, 0, status)


def solve_batch(fields_t: Array, pad: Pad) -> tuple[Array, Array, Array]:
    """Independent fields (K, N, 3), each solved from rest: positions (K, 3) m, unit axes (K, 3), remanences (K,) T.

    Rows that could not be solved are NaN.
    """
    estimates = [solve(field, pad) for field in fields_t]
    solved = np.array([estimate.status is Status.CONVERGED for estimate in estimates])
    position = np.array([estimate.position_m for estimate in estimates])
    axis = np.array([estimate.axis for estimate in estimates])
    remanence = np.array([estimate.remanence_t for estimate in estimates])
    position[~solved], axis[~solved], remanence[~solved] = np.nan, np.nan, np.nan
    return position, axis, remanence
