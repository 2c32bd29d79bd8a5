"""Any problem of the solver's, with any role for any part, judged where its search ended: docs/pose.md.

A sample is predicted at the state's time minus its age, to first order, so age·J·rate is added to its value, and
age·J²·diffusion to its variance. An axis a is away from its prior's m by Tₘᵀa/(a·m). All derivatives by differences.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fmfts.pose import Part, Problem, State
from oracle.field import Array, OneMagnet, differences, tangents
from oracle.problems import Pose, covariance, information

# docs/pose.md: of the distance to the nearest sensor, and of a radian.
TOO_UNCERTAIN = 0.25


class Judged(NamedTuple):
    """The values at a state: the remaining step to the minimum, the covariance, χ² at the most probable value of the
    considered parts, and the deviations (columns,) that the estimated parts have before anything is considered.
    """

    left: Array
    covariance: Array
    chi2: float
    deviation: Array


def pose_of(problem: Problem, state: State) -> Pose:
    """Drops the rows without a value or a weight."""
    rows = problem.measurements[np.isfinite(problem.measurements[:, 6]) & np.isfinite(problem.measurements[:, 7])]
    magnets = [
        OneMagnet(one.position_m, one.axis, one.log_moment, *magnet)
        for one, magnet in zip((state, *state.neighbours), problem.magnets.tolist(), strict=True)
    ]
    there = Pose(
        rows[:, :3], rows[:, 3:6], rows[:, 6], np.ones(len(rows)), magnets, state.ambient_t, state.gradient_t_per_m
    )
    value, variance = rows[:, 6], rows[:, 7] ** 2 + (rows[:, 8] * rows[:, 6]) ** 2
    if problem.motion is not None:
        at_start = pose_of(Problem(rows, problem.magnets, problem.parts, problem.start), problem.start)
        J = at_start.deviation_t[:, None] * at_start.jacobian(np.zeros(state.columns))
        value = value + rows[:, 9] * (J @ problem.motion.rate)
        variance = variance + rows[:, 9] * (J**2 @ problem.motion.diffusion)
    return Pose(
        there.place_m, there.direction, value, np.sqrt(variance), magnets, there.ambient_t, there.gradient_t_per_m
    )


def away(pose: Pose, mean: State, step: Array) -> Array:
    """d (columns,): from the prior's mean to the pose, moved by a step."""
    magnets, ambient_t, gradient_t_per_m = pose.stepped(step)
    own, *others = (
        [*(one.position_m - there.position_m), *(tangents(there.axis).T @ one.axis / (one.axis @ there.axis)),
         one.log_moment - there.log_moment]
        for one, there in zip(magnets, (mean, *mean.neighbours), strict=True)
    )  # fmt: skip
    around = ambient_t - mean.ambient_t, gradient_t_per_m - mean.gradient_t_per_m
    return np.concatenate([own, *around, *others])


def judged(problem: Problem, state: State) -> Judged:
    pose, columns, prior = pose_of(problem, state), state.columns, problem.prior
    nowhere = np.zeros(columns)
    active = np.flatnonzero(np.isin(problem.parts, (Part.FREE, Part.PRIOR))).tolist()
    considered = np.flatnonzero(problem.parts == Part.CONSIDERED).tolist()
    J, rho = pose.jacobian(nowhere), pose.residual(nowhere)
    told = np.flatnonzero(np.isin(problem.parts, (Part.PRIOR, Part.CONSIDERED))).tolist()
    normal, slope, chi2 = J.T @ J, J.T @ rho, float(rho @ rho)
    if prior is not None:
        d, omega = away(pose, prior.mean, nowhere), information(prior.covariance, columns, told)
        D = differences(lambda step: away(pose, prior.mean, step), nowhere, pose.steps)
        normal, slope, chi2 = normal + D.T @ omega @ D, slope - D.T @ omega @ d, chi2 + d @ omega @ d
    used = [*active, *considered]
    scale = 1.0 / np.sqrt(np.diag(normal))
    scaled, pull = normal * scale[:, None] * scale, slope * scale
    left, deviation = np.zeros(columns), np.zeros(columns)
    left[active] = scale[active] * np.linalg.solve(scaled[np.ix_(active, active)], pull[active])
    deviation[active] = scale[active] * np.sqrt(np.diag(np.linalg.inv(scaled[np.ix_(active, active)])))
    chi2 -= pull[used] @ np.linalg.solve(scaled[np.ix_(used, used)], pull[used])
    held = None if prior is None else prior.covariance
    return Judged(left, covariance(normal, active, considered, held), float(chi2), deviation)


def is_too_uncertain(problem: Problem, state: State, deviation: Array) -> bool:
    """Whether a position or an axis is too uncertain for a covariance to mean anything."""
    pose = pose_of(problem, state)
    for number, magnet in enumerate(pose.magnets):
        own = deviation[14 + 6 * (number - 1) :] if number else deviation
        distance_m = np.linalg.norm(pose.place_m - magnet.position_m, axis=1).min()
        if (own[:3] > TOO_UNCERTAIN * distance_m).any() or (own[3:5] > TOO_UNCERTAIN).any():
            return True
    return False
