"""A pose problem as docs/pose.md states it, judged by SciPy: residuals, χ², and the covariance from differences.

docs/pose.md: ρ in deviations, d the step from the prior's mean, χ² = |ρ|² + dᵀP⁻¹d; the covariance is A⁻¹ with A = JᵀJ
+ DᵀP⁻¹D, and with considered parts c it is A⁻¹ + S P_cc Sᵀ with S = −A⁻¹ A_xc (S. F. Schmidt, 1966). No prior of these
tests turns an axis far, so that D is the identity to second order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from oracle.field import Array, OneMagnet, differences, reading, turned

STEPS = np.array([1e-6] * 3 + [1e-4] * 2 + [1e-4] + [1e-7] * 3 + [1e-6] * 5)
OF_NEIGHBOUR = np.array([1e-5] * 3 + [1e-4] * 3)


@dataclass(frozen=True, slots=True)
class Pose:
    """The start and all fixed quantities. magnets: the pad's own first. A step h has 14 + 6k numbers."""

    place_m: Array
    direction: Array
    value_t: Array
    deviation_t: Array
    magnets: list[OneMagnet]
    ambient_t: Array
    gradient_t_per_m: Array

    def stepped(self, step: Array) -> tuple[list[OneMagnet], Array, Array]:
        moved = []
        for number, one in enumerate(self.magnets):
            own = step[:6] if number == 0 else step[14 + 6 * (number - 1) :][:6]
            position, axis = one.position_m + own[:3], turned(one.axis, own[3:5])
            moved.append(OneMagnet(position, axis, one.log_moment + own[5], one.strength_t_m3, one.kappa_m2))
        return moved, self.ambient_t + step[6:9], self.gradient_t_per_m + step[9:14]

    def residual(self, step: Array) -> Array:
        return (self.value_t - reading(self.place_m, self.direction, *self.stepped(step))) / self.deviation_t

    @property
    def steps(self) -> Array:
        return np.concatenate([STEPS, np.tile(OF_NEIGHBOUR, len(self.magnets) - 1)])

    def jacobian(self, step: Array) -> Array:
        """The derivative (rows, columns) of the readings in deviations, by a step."""
        return -differences(self.residual, step, self.steps)


def solved(pose: Pose, free: list[int], prior: Array | None = None) -> tuple[Array, float]:
    """The step (columns,) and χ². prior (columns, columns): covariance of the free columns about the start; None:
    none."""
    root = None if prior is None else np.linalg.cholesky(np.linalg.inv(prior[np.ix_(free, free)])).T
    scale = pose.steps[free] * 1e2

    def residual(unknown: Array) -> Array:
        step = np.zeros(len(pose.steps))
        step[free] = unknown * scale
        own = pose.residual(step)
        return own if root is None else np.concatenate([own, root @ step[free]])

    def jacobian(unknown: Array) -> Array:
        """SciPy's own first differences end 1e-4 of a deviation off on a processor without fused multiply-add."""
        return differences(residual, unknown, np.full(len(free), 1e-2))

    found = least_squares(residual, np.zeros(len(free)), jacobian, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    step = np.zeros(len(pose.steps))
    step[free] = found.x * scale
    return step, float(2.0 * found.cost)


def covariance(normal: Array, free: list[int], considered: list[int], held: Array | None) -> Array:
    """(columns, columns). normal: A, at the solution. held: the prior's covariance; only the considered columns' part
    is used."""
    columns = len(normal)
    A, A_xc = normal[np.ix_(free, free)], normal[np.ix_(free, considered)]
    scale = 1.0 / np.sqrt(np.diag(A))
    inverse = scale[:, None] * np.linalg.inv(A * scale[:, None] * scale) * scale
    whole = np.zeros((columns, columns))
    whole[np.ix_(free, free)] = inverse
    if considered:
        assert held is not None
        P, S = held[np.ix_(considered, considered)], -inverse @ A_xc
        whole[np.ix_(free, free)] += S @ P @ S.T
        whole[np.ix_(free, considered)] = S @ P
        whole[np.ix_(considered, free)] = (S @ P).T
        whole[np.ix_(considered, considered)] = P
    return whole


def information(prior: Array | None, columns: int, told: list[int]) -> Array:
    """(columns, columns): P⁻¹ of the columns that have a prior."""
    whole = np.zeros((columns, columns))
    if prior is not None:
        whole[np.ix_(told, told)] = np.linalg.inv(prior[np.ix_(told, told)])
    return whole
