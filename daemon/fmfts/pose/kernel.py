"""Chooses the solver: the compiled kernel if it could be built, else the NumPy reference."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fmfts.pose.problem import Motion, Parts, Prior, Problem, Solution, Status
from fmfts.pose.reference import solve_reference
from fmfts.pose.state import NEIGHBOUR_SIZE, SIZE, State

try:
    from fmfts.pose import _kernel
except ImportError:  # no compiler was there when the package was built
    _kernel = None  # type: ignore[assignment]

Array = NDArray[np.float64]

# FMFTS_SOLVER=numpy turns the kernel off, for comparisons.
SOLVER: Literal["c", "numpy"] = "numpy" if _kernel is None or os.environ.get("FMFTS_SOLVER") == "numpy" else "c"

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

    def solve(self, stop_chi2: float, max_iterations: int, project: bool = False) -> None:
        """Fill the results: with one call of the kernel, which releases the GIL, or one by one with the reference."""
        if SOLVER == "c":
            self.solve_compiled(stop_chi2, max_iterations, project)
            return
        for index in range(len(self.summary)):
            self._put(index, solve_reference(self._problem(index, stop_chi2, max_iterations, project)))

    def solve_compiled(self, stop_chi2: float, max_iterations: int, project: bool = False) -> None:
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

    def _problem(self, index: int, stop_chi2: float, max_iterations: int, project: bool) -> Problem:
        prior = motion = None
        if self.prior_mean is not None and self.prior_covariance is not None:
            prior = Prior(State.from_vector(self.prior_mean[index]), self.prior_covariance[index])
        if self.rate is not None or self.diffusion is not None:
            none = np.zeros(self.parts.shape[1])
            rate = none if self.rate is None else self.rate[index]
            motion = Motion(rate, none if self.diffusion is None else self.diffusion[index])
        return Problem(
            self.measurements[index],
            self.magnets[index],
            self.parts[index],
            State.from_vector(self.start[index]),
            prior,
            motion,
            stop_chi2,
            max_iterations,
            project,
        )

    def _put(self, index: int, solution: Solution) -> None:
        self.state[index] = solution.state.vector()
        self.covariance[index] = solution.covariance
        self.direction[index] = solution.direction
        # In the order of STATUS … UNKNOWNS.
        self.summary[index] = (
            *(STATUSES.index(solution.status), solution.chi2, solution.residual_t),
            *(solution.iterations, solution.rows, solution.unknowns),
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


def solve_problem(problem: Problem) -> Solution:
    """The most probable state; see fmfts.pose.problem."""
    return solve_kernel(problem) if SOLVER == "c" else solve_reference(problem)


def solve_kernel(problem: Problem) -> Solution:
    prior, motion = problem.prior, problem.motion
    batch = Batch.of(
        problem.measurements[None],
        problem.magnets[None],
        problem.parts[None],
        problem.start.vector()[None],
        None if prior is None else prior.mean.vector()[None],
        None if prior is None else prior.covariance[None],
        None if motion is None else motion.rate[None],
        None if motion is None else motion.diffusion[None],
    )
    batch.solve_compiled(problem.stop_chi2, problem.max_iterations, problem.project)
    return batch.solution(0)
