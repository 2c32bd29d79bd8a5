"""Where the magnet is when nothing is known of it: a cold start from positions alone.

The moment and the ambient field are linear given the position, so the search has three dimensions (variable projection,
fmfts.pose.projection). A few starts cost a few hundred microseconds together, and tell whether the answer is the only
one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import eigen, length, product, singular_values, solve
from fmfts.pose.kernel import Batch
from fmfts.pose.model import brought_to_now, predict, usable_rows
from fmfts.pose.problem import PLACE, Part, Problem, Solution, Status
from fmfts.pose.state import POSITION, State

Array = NDArray[np.float64]

# Two minima are one if they are closer than this many deviations of the position: searches stop within 0.03.
SAME_DEVIATIONS = 0.5
# A covariance is a tangent. It is looked along as far as answers are believed, and may miss the readings by so much of
# what it moves them. In a million starts of three sensors with eight unknowns, each answer beyond its deviations missed
# by at least 0.66, and 0.7 % of the good ones by 0.5; with four sensors none missed by 0.1.
BELIEVED_DEVIATIONS = 3.0
STRAIGHT = 0.5


@dataclass(frozen=True, slots=True)
class Acquired:
    """best: the lowest minimum. rivals: others whose χ² is within the limit: where there are any, `best` is a guess.

    bent: the readings turn away from `best`'s covariance within its deviations, so that it tells too little.
    """

    best: Solution
    rivals: tuple[Solution, ...]
    bent: bool = False


def acquire(problem: Problem, starts_m: Array, chi2_limit: float) -> Acquired:
    """The minimum of `problem` from several positions (K, 3) m; its start gives what is fixed or considered.

    chi2_limit: what a right answer stays under. Axis, moment and ambient of the start are used where they are known.
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


def starts_around(measurements: Array, distance_m: float) -> Array:
    """Twelve positions (12, 3): on both sides of the plane that the places lie about, near and far, amid and aside."""
    places = np.unique(measurements[:, PLACE], axis=0)
    middle = places.mean(axis=0)
    along, across, normal = singular_values(places - middle)[2].T
    aside = 0.6 * np.array([along, -along, across, -across])
    one_side = np.array([0.6 * normal, 1.5 * normal, *(normal + aside)])
    starts: Array = middle + distance_m * np.concatenate(
        [one_side, one_side - 2.0 * np.outer(product(one_side, normal), normal)]
    )
    return starts


def starts_in_box(middle_m: Array, half_m: Array) -> Array:
    """27 positions (27, 3): a box's corners, edges, faces and middle. half_m (3,): half its sides."""
    corner = np.array([-1.0, 0.0, 1.0])
    grid = np.stack(np.meshgrid(corner, corner, corner, indexing="ij"), axis=-1).reshape(-1, 3)
    starts: Array = middle_m + half_m * grid
    return starts


def _solve_each(problem: Problem, starts: list[State]) -> list[Solution]:
    prior, motion = problem.prior, problem.motion
    batch = Batch.of(
        np.repeat(problem.measurements[None], len(starts), axis=0),
        problem.magnets,
        problem.parts,
        np.array([start.vector() for start in starts]),
        None if prior is None else prior.mean.vector(),
        None if prior is None else prior.covariance,
        None if motion is None else motion.rate,
        None if motion is None else motion.diffusion,
    )
    batch.solve(problem.stop_chi2, problem.max_iterations, problem.project)
    return [batch.solution(index) for index in range(len(starts))]


def _bent(problem: Problem, best: Solution) -> bool:
    """Whether the field is not linear along the least certain direction, each column in units of its deviation."""
    columns = np.flatnonzero(np.isin(problem.parts, (Part.FREE, Part.PRIOR)))
    covariance = best.covariance[np.ix_(columns, columns)]
    deviation = np.sqrt(np.diagonal(covariance))
    variances, directions = eigen(covariance / np.outer(deviation, deviation))
    step = np.zeros(len(problem.parts))
    step[columns] = BELIEVED_DEVIATIONS * np.sqrt(variances[-1]) * deviation * directions[:, -1]
    rows = usable_rows(problem)
    assert rows is not None  # or `best` had not converged
    _, weight = brought_to_now(problem, rows)
    value, jacobian = predict(rows, problem.magnets, best.state)
    for way in (step, -step):
        moved, _ = predict(rows, problem.magnets, best.state.stepped(way))
        missed = (moved - value - product(jacobian, way)) * weight
        if not length(missed) <= STRAIGHT * BELIEVED_DEVIATIONS:
            return True
    return False


def _differ(first: Solution, second: Solution) -> bool:
    away = first.state.position_m - second.state.position_m
    spread = first.covariance[POSITION, POSITION] + second.covariance[POSITION, POSITION]
    return bool(product(away, solve(spread, away)) > SAME_DEVIATIONS * SAME_DEVIATIONS)
