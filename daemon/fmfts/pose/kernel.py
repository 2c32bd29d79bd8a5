"""Calls the compiled solver, solver.c: for one problem, or for many at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.pose import _kernel
from fmfts.pose.problem import Parts, Problem, Solution, Status
from fmfts.pose.state import NEIGHBOUR_SIZE, SIZE, State

Array = NDArray[np.float64]

STATUSES = (Status.CONVERGED, Status.AT_LIMIT, Status.UNOBSERVABLE, Status.INVALID)
# The columns of a summary, in the order in which _kernel.c writes them.
STATUS, CHI2, RESIDUAL, ITERATIONS, ROWS, UNKNOWNS = range(6)
SUMMARY = 6


@dataclass(frozen=True, slots=True)
class Batch:
    """K independent problems with equally many rows and magnets, for one call of the kernel; arrays are contiguous.

    Arrays are those of `Problem`, K in front: measurements (K, rows, 10), magnets (K, M, 2), parts (K, columns), start
    (K, values: `State.vector`), prior_mean (K, values), prior_covariance (K, columns, columns), rate and diffusion
    (K, columns). Results are written to state, covariance, direction and summary (K, 6: STATUS …), which may be reused.
    """

    measurements: Array
    magnets: Array
    parts: Parts
    start: Array
    state: Array
    covariance: Array
    direction: Array
    summary: Array
    prior_mean: Array | None = None
    prior_covariance: Array | None = None
    rate: Array | None = None
    diffusion: Array | None = None

    @classmethod
    def of(
        cls,
        measurements: Array,
        magnets: Array,
        parts: Parts,
        start: Array,
        prior_mean: Array | None = None,
        prior_covariance: Array | None = None,
        *,
        rate: Array | None = None,
        diffusion: Array | None = None,
    ) -> Batch:
        """Make inputs contiguous, and arrays for results. Inputs without the leading K are repeated K times."""
        count, columns = len(measurements), columns_of(magnets.shape[-2])

        def each(values: Array | None, dimensions: int) -> Array | None:
            if values is None or values.ndim == dimensions:
                return values if values is None else np.ascontiguousarray(values, dtype=np.float64)
            return np.ascontiguousarray(np.broadcast_to(values, (count, *values.shape)), dtype=np.float64)

        whole = (each(measurements, 3), each(magnets, 3), each(start, 2))
        assert whole[0] is not None
        assert whole[1] is not None
        assert whole[2] is not None
        return cls(
            measurements=whole[0],
            magnets=whole[1],
            parts=np.ascontiguousarray(np.broadcast_to(parts, (count, columns)), dtype=np.uint8),
            start=whole[2],
            state=np.empty((count, whole[2].shape[1])),
            covariance=np.empty((count, columns, columns)),
            direction=np.empty((count, columns)),
            summary=np.empty((count, SUMMARY)),
            prior_mean=each(prior_mean, 2),
            prior_covariance=each(prior_covariance, 3),
            rate=each(rate, 2),
            diffusion=each(diffusion, 2),
        )

    @classmethod
    def of_problem(cls, problem: Problem, starts: Sequence[State]) -> Batch:
        """The problem from each of these starts."""
        prior, motion = problem.prior, problem.motion
        return cls.of(
            np.repeat(problem.measurements[None], len(starts), axis=0),
            problem.magnets,
            problem.parts,
            np.array([start.vector() for start in starts]),
            None if prior is None else prior.mean.vector(),
            None if prior is None else prior.covariance,
            rate=None if motion is None else motion.rate,
            diffusion=None if motion is None else motion.diffusion,
        )

    def solve(self, stop_chi2: float, max_iterations: int, project: bool = False) -> None:
        """Fill the results, with one call that releases the GIL."""
        count, rows, _ = self.measurements.shape
        _kernel.solve(
            count,
            rows,
            self.magnets.shape[1],
            self.measurements,
            self.magnets,
            self.parts,
            self.start,
            self.prior_mean,
            self.prior_covariance,
            self.rate,
            self.diffusion,
            stop_chi2,
            max_iterations,
            project,
            self.state,
            self.covariance,
            self.direction,
            self.summary,
        )

    def solution(self, index: int) -> Solution:
        summary = self.summary[index].tolist()
        return Solution(
            state=State.from_vector(self.state[index]),
            covariance=self.covariance[index],
            chi2=summary[CHI2],
            rows=int(summary[ROWS]),
            unknowns=int(summary[UNKNOWNS]),
            residual_t=summary[RESIDUAL],
            iterations=int(summary[ITERATIONS]),
            status=STATUSES[int(summary[STATUS])],
            direction=self.direction[index],
        )


def columns_of(magnets: int) -> int:
    return SIZE + NEIGHBOUR_SIZE * (magnets - 1)


def predict(rows: Array, magnets: Array, state: State) -> tuple[Array, Array]:
    """The prediction (rows,) in tesla of each measurement (rows, 10), and its derivative by a step (rows, columns)."""
    predicted, jacobian = np.empty(len(rows)), np.empty((len(rows), state.columns))
    _kernel.read(*map(np.ascontiguousarray, (rows, magnets, state.vector())), predicted, jacobian)
    return predicted, jacobian


def deviations(problem: Problem) -> Array | None:
    """The deviations (rows,) of the measurements at the state's time: infinite where one is left out; None if one is
    invalid.
    """
    found, motion = np.empty(len(problem.measurements)), problem.motion
    arrays = map(np.ascontiguousarray, (problem.measurements, problem.magnets, problem.start.vector()))
    rates = (None, None) if motion is None else (motion.rate, motion.diffusion)
    return found if _kernel.deviations(*arrays, *rates, found) else None


def solve_problem(problem: Problem) -> Solution:
    """The most probable state; see fmfts.pose.problem."""
    batch = Batch.of_problem(problem, [problem.start])
    batch.solve(problem.stop_chi2, problem.max_iterations, problem.project)
    return batch.solution(0)
