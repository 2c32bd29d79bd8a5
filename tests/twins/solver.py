"""The solver, written to be read: Levenberg–Marquardt on measurements and prior, in NumPy.

The residuals are ρ = (measured − predicted)/deviation, and J is the Jacobian of the prediction. d is the step from the
prior's mean, and Ω = P⁻¹ the prior's information. Each step h solves (A + λ diag A) h = g, where A = JᵀJ + DᵀΩD,
g = Jᵀρ − DᵀΩd, and D is the derivative of d: the identity, except for the axis, which lies on a sphere (docs/pose.md).

Not a witness: it was the daemon's own NumPy, and holds solver.c to a billionth. tests/oracle judges both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import length, product, solve
from fmfts.pose.model import UNIT, brought_to_now, magnets_of, predict, usable_rows
from fmfts.pose.problem import PLACE, VALUE, Part, Parts, Problem, Solution, Status
from fmfts.pose.projection import best_linear_parts
from fmfts.pose.state import AXIS, POSITION, State, tangent_basis
from twins.normal_matrix import damped_step, inverse_of, weakest_step

Array = NDArray[np.float64]

FIRST_DAMPING = 1e-4
NO_DAMPING = 1e-7  # below this, Marquardt's step equals the Gauss–Newton step
ROUNDING = 1e-12  # relative error of a sum of squares
# A deviation above this share of the distance to the nearest sensor, or of a radian, is meaningless: the field falls
# with the third power of the distance, so the model is not linear over it, and the covariance is wrong.
UNCERTAIN = 0.25


class Linear(NamedTuple):
    """The problem linearised at one state: χ², A and g, and the sum of squared residuals in T²."""

    chi2: float
    normal: Array
    gradient: Array
    residual_square: float


def solve_reference(problem: Problem) -> Solution:
    """The most probable state; see fmfts.pose.problem."""
    active = np.flatnonzero(np.isin(problem.parts, (Part.FREE, Part.PRIOR)))
    considered = np.flatnonzero(problem.parts == Part.CONSIDERED)
    rows = usable_rows(problem)
    information = _information(problem)
    if rows is None or information is None or not _valid(problem):
        return _failed(problem, problem.start, Status.INVALID)
    order = np.concatenate([active, considered])
    value, weight = brought_to_now(problem, rows)
    if not (np.isfinite(weight) & (weight > 0.0)).all():  # a square is beyond a double's range
        return _failed(problem, problem.start, Status.INVALID)
    rows = np.column_stack([rows[:, :VALUE], value, rows[:, VALUE + 1 :]])
    search = _Search(problem, rows, weight, information[np.ix_(order, order)], order, len(active))
    return search.run()


class _Search:
    def __init__(
        self, problem: Problem, rows: Array, weight: Array, information: Array, order: NDArray[np.intp], active: int
    ) -> None:
        self._problem = problem
        self._rows = rows
        self._weight = weight
        self._information = information
        self._order = order  # the active columns, then the considered ones
        self._active = active

    def run(self) -> Solution:
        problem, active = self._problem, slice(0, self._active)
        state = problem.start
        if problem.project:
            state = best_linear_parts(self._rows, self._weight, problem, state) or state
        linear = self._linearise(state)
        if not np.isfinite(linear.chi2):
            return _failed(problem, state, Status.INVALID)
        damping, iterations, status = 0.0, 0, Status.AT_LIMIT
        while iterations < problem.max_iterations:
            step, promised = damped_step(linear.normal[active, active], linear.gradient[active], damping)
            if step is None:
                damping = max(FIRST_DAMPING, 10.0 * damping)
                iterations += 1
                continue
            tried = self._stepped(state, step)
            if promised <= problem.stop_chi2 and damping <= FIRST_DAMPING:
                # The remaining gain is not worth another evaluation of the model: take the step and stop.
                state, status = tried, Status.CONVERGED
                linear = linear._replace(chi2=linear.chi2 - promised)
                break
            iterations += 1
            if problem.project:
                tried = best_linear_parts(self._rows, self._weight, problem, tried) or tried
            tried_linear = self._linearise(tried)
            if tried_linear.chi2 <= linear.chi2 * (1.0 + ROUNDING):
                state, linear = tried, tried_linear
                damping = 0.1 * damping if damping > NO_DAMPING else 0.0
            else:
                damping = max(FIRST_DAMPING, 10.0 * damping)
        return self._solution(state, linear, iterations, status)

    def _stepped(self, state: State, step: Array) -> State:
        move = np.zeros(state.columns)
        move[self._order[: self._active]] = step
        return state.stepped(move)

    def _linearise(self, state: State) -> Linear:
        """χ², A and g. χ² is infinite if the state is impossible: a magnet in a sensor, or an axis over 90° away."""
        problem = self._problem
        with np.errstate(all="ignore"):
            predicted, jacobian = predict(self._rows, problem.magnets, state)
            raw = self._rows[:, VALUE] - predicted
            residual = self._weight * raw
            weighted = self._weight[:, None] * jacobian[:, self._order]
            normal, gradient = product(weighted.T, weighted), product(weighted.T, residual)
            chi2 = product(residual, residual)
            if problem.prior is not None:
                away, by_step = _from_mean(state, problem.prior.mean, problem.parts)
                turn = by_step[np.ix_(self._order, self._order)]
                pull = product(self._information, away[self._order])
                normal = normal + product(turn.T, self._information, turn)
                gradient = gradient - product(turn.T, pull)
                chi2 += product(away[self._order], pull)
            finite = np.isfinite(chi2) and bool(np.isfinite(normal).all())
            return Linear(chi2 if finite else np.inf, normal, gradient, product(raw, raw))

    def _solution(self, state: State, linear: Linear, iterations: int, status: Status) -> Solution:
        problem, active = self._problem, slice(0, self._active)
        normal = linear.normal[active, active]
        inverse = inverse_of(normal)
        columns = self._order[: self._active]
        if inverse is None or self._uncertain(state, np.sqrt(np.diagonal(inverse))):
            direction = weakest_step(normal, columns, state.columns)
            return _failed(problem, state, Status.UNOBSERVABLE, len(self._rows), direction)
        covariance, chi2 = self._with_considered(inverse, linear)
        whole = np.zeros((state.columns, state.columns))
        whole[np.ix_(self._order, self._order)] = covariance
        return Solution(
            state=state,
            covariance=whole,
            chi2=chi2,
            rows=len(self._rows),
            unknowns=int((problem.parts == Part.FREE).sum()),
            residual_t=float(np.sqrt(linear.residual_square / len(self._rows))) if len(self._rows) else 0.0,
            iterations=iterations,
            status=status,
            direction=np.full(state.columns, np.nan),
        )

    def _with_considered(self, inverse: Array, linear: Linear) -> tuple[Array, float]:
        """Covariance over (active, considered), and χ² at the most probable value of the considered parts.

        The estimate moves by S = −A⁻¹·A_xc per unit of the considered parts; these keep the variance of the prior.
        """
        active, rest = slice(0, self._active), slice(self._active, None)
        if self._active == len(self._order):
            return inverse, linear.chi2
        assert self._problem.prior is not None
        columns = self._order[rest]
        variance = self._problem.prior.covariance[np.ix_(columns, columns)]
        cross = linear.normal[active, rest]
        sensitivity = product(-inverse, cross)
        shared = product(sensitivity, variance)
        covariance = np.block([[inverse + product(shared, sensitivity.T), shared], [shared.T, variance]])
        slope = linear.gradient[rest] + product(sensitivity.T, linear.gradient[active])
        gain = product(slope, solve(linear.normal[rest, rest] + product(cross.T, sensitivity), slope))
        return covariance, linear.chi2 - gain

    def _uncertain(self, state: State, deviation: Array) -> bool:
        """Whether a position or an axis is so uncertain that its covariance is meaningless; see UNCERTAIN."""
        full = np.zeros(state.columns)
        full[self._order[: self._active]] = deviation
        for first, magnet in magnets_of(state):
            distance = np.sqrt(square(self._rows[:, PLACE] - magnet.position_m).sum(axis=1).min(initial=np.inf))
            own = full[first:]
            if (own[POSITION] > UNCERTAIN * distance).any() or (own[AXIS] > UNCERTAIN).any():
                return True
        return False


def _valid(problem: Problem) -> bool:
    """Whether start, parts and settings are valid."""
    states = [problem.start] if problem.prior is None else [problem.start, problem.prior.mean]
    for state in states:
        if not np.isfinite(state.vector()).all():
            return False
        for first, magnet in magnets_of(state):
            tilt = problem.parts[first:][AXIS]
            if abs(length(magnet.axis) - 1.0) > UNIT or tilt[0] != tilt[1]:
                return False
    if problem.motion is not None:
        rate, diffusion = problem.motion.rate, problem.motion.diffusion
        if not (np.isfinite(rate) & np.isfinite(diffusion) & (diffusion >= 0.0)).all():
            return False
    magnets, stop = problem.magnets, problem.stop_chi2
    known_parts = bool((problem.parts <= max(Part)).all())
    return known_parts and bool(np.isfinite(magnets).all() and (magnets[:, 0] > 0.0).all() and 0.0 < stop < np.inf)


def _information(problem: Problem) -> Array | None:
    """Ω (columns, columns): the inverse of the prior's covariance, zero without a prior; None if it has no inverse."""
    information = np.zeros((len(problem.parts), len(problem.parts)))
    columns = np.flatnonzero(np.isin(problem.parts, (Part.PRIOR, Part.CONSIDERED)))
    if len(columns):
        if problem.prior is None:
            return None
        inverse = inverse_of(problem.prior.covariance[np.ix_(columns, columns)])
        if inverse is None:
            return None
        information[np.ix_(columns, columns)] = inverse
    return information


def _from_mean(state: State, mean: State, parts: Parts) -> tuple[Array, Array]:
    """The step d (columns,) from a prior's mean, and its derivative D (columns, columns) by a step from `state`.

    For an axis a, the mean's axis m, and its tangent basis T_m, d = T_mᵀa/(a·m); NaN if they are 90° or more apart.
    """
    away, by_step = state.step_from(mean), np.eye(state.columns)
    for (first, magnet), (_, origin) in zip(magnets_of(state), magnets_of(mean), strict=True):
        tilt = slice(first + AXIS.start, first + AXIS.stop)
        if parts[tilt.start] in (Part.FREE, Part.FIXED):
            continue  # this axis has no prior: any distance is allowed
        along = product(magnet.axis, origin.axis)
        basis, to_mean = tangent_basis(magnet.axis), tangent_basis(origin.axis).T
        away[tilt] = product(to_mean, magnet.axis) / along if along > 0.0 else np.nan
        by_step[tilt, tilt] = (
            product(to_mean, basis) / along - np.outer(away[tilt], product(origin.axis, basis)) / along
        )
    return away, by_step


def _failed(problem: Problem, state: State, status: Status, rows: int = 0, direction: Array | None = None) -> Solution:
    """A solution whose numbers are all NaN."""
    nan = float("nan")
    unknown = np.full(state.columns, nan)
    return Solution(
        state=state,
        covariance=np.full((state.columns, state.columns), nan),
        chi2=nan,
        rows=rows,
        unknowns=int((problem.parts == Part.FREE).sum()),
        residual_t=nan,
        iterations=0,
        status=status,
        direction=unknown if direction is None else direction,
    )
