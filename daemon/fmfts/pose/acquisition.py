"""Cold start: finds the magnet when nothing is known of it, from several start positions.

For a given position, the moment and the ambient field are linear unknowns, so the search has only three dimensions
(variable projection: projection.c). A few starts together take a few hundred microseconds, and show whether
there is more than one solution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import eigen, length, product, solve
from fmfts.pose.kernel import Batch, deviations, predict
from fmfts.pose.problem import Part, Problem, Solution, Status
from fmfts.pose.state import POSITION, State

Array = NDArray[np.float64]

# Two minima count as one if they are closer than this many deviations of the position. Searches stop within 0.03.
SAME_DEVIATIONS = 0.5
# A covariance assumes a linear field. A solution counts as bent if, BELIEVED_DEVIATIONS away along its least certain
# direction, the field misses the linear prediction by more than the share STRAIGHT of the predicted change. In a
# million starts of three sensors with eight unknowns, each answer beyond its deviations missed by at least 0.66. 0.7 %
# of the good answers missed by 0.5. With four sensors no answer missed by 0.1.
BELIEVED_DEVIATIONS = 3.0
STRAIGHT = 0.5


@dataclass(frozen=True, slots=True)
class Acquired:
    """best: the lowest minimum. rivals: other minima whose χ² is within the limit; if there are any, `best` is a guess.

    bent: the field is not linear within the deviations of `best`, so its covariance is too small.
    """

    best: Solution
    rivals: tuple[Solution, ...]
    bent: bool = False


def acquire(problem: Problem, starts_m: Array, chi2_limit: float) -> Acquired:
    """Solve `problem` from several start positions (K, 3) m. `problem.start` gives the fixed and considered parts.

    chi2_limit: the χ² that a right answer does not exceed.
    """
    dipole = problem.magnets * [1.0, 0.0]
    coarse = replace(problem, magnets=dipole, motion=None, project=True)
    found = _solve_each(coarse, [replace(problem.start, position_m=place) for place in starts_m])
    solved = [solution.state for solution in found if solution.status is not Status.INVALID]
    fine = _solve_each(problem, solved or [problem.start])
    ranked = sorted(fine, key=lambda solution: (not np.isfinite(solution.chi2), solution.chi2))
    best = ranked[0]
    if best.status in (Status.UNOBSERVABLE, Status.INVALID):
        return Acquired(best, ())
    rivals: list[Solution] = []
    for other in ranked[1:]:
        fits = other.status is Status.CONVERGED and other.chi2 <= chi2_limit
        if fits and all(_differ(other, known) for known in (best, *rivals)):
            rivals.append(other)
    return Acquired(best, tuple(rivals), best.status is Status.CONVERGED and _bent(problem, best))


def starts_in_box(middle_m: Array, half_m: Array) -> Array:
    """Start positions (27, 3) m: corners, edges, faces and middle of a box. half_m (3,): half of its sides."""
    corner = np.array([-1.0, 0.0, 1.0])
    grid = np.stack(np.meshgrid(corner, corner, corner, indexing="ij"), axis=-1).reshape(-1, 3)
    starts: Array = middle_m + half_m * grid
    return starts


def _solve_each(problem: Problem, starts: list[State]) -> list[Solution]:
    batch = Batch.of_problem(problem, starts)
    batch.solve(problem.stop_chi2, problem.max_iterations, problem.project)
    return [batch.solution(index) for index in range(len(starts))]


def _bent(problem: Problem, best: Solution) -> bool:
    """Whether the field is not linear along the least certain direction (see STRAIGHT)."""
    columns = np.flatnonzero(np.isin(problem.parts, (Part.FREE, Part.PRIOR)))
    covariance = best.covariance[np.ix_(columns, columns)]
    deviation = np.sqrt(np.diagonal(covariance))
    variances, directions = eigen(covariance / np.outer(deviation, deviation))
    step = np.zeros(len(problem.parts))
    step[columns] = BELIEVED_DEVIATIONS * np.sqrt(variances[-1]) * deviation * directions[:, -1]
    known = deviations(problem)
    assert known is not None  # a singular covariance would have prevented convergence
    rows, known = problem.measurements[np.isfinite(known)], known[np.isfinite(known)]
    value, jacobian = predict(rows, problem.magnets, best.state)
    for move in (step, -step):
        moved, _ = predict(rows, problem.magnets, best.state.stepped(move))
        missed = (moved - value - product(jacobian, move)) / known
        if not length(missed) <= STRAIGHT * BELIEVED_DEVIATIONS:
            return True
    return False


def _differ(first: Solution, second: Solution) -> bool:
    away = first.state.position_m - second.state.position_m
    spread = first.covariance[POSITION, POSITION] + second.covariance[POSITION, POSITION]
    return bool(product(away, solve(spread, away)) > SAME_DEVIATIONS * SAME_DEVIATIONS)
