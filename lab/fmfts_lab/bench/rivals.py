"""SciPy's solvers on the paper's six unknowns, to compare their time and error with those of the kernel."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares, leastsq

from fmfts.pad import Pad
from fmfts.pose import Problem
from fmfts.pose.problem import NOISE, VALUE
from fmfts_lab.bench.workspace import Array

# Units in which all unknowns are near one: 10 mm, and the nominal moment.
POSITION_UNIT_M = 1e-2


def moment_vector_solvers(pad: Pad) -> dict[str, Callable[[Problem], object]]:
    """Solvers for position and moment vector, as a user of SciPy would write them, for sensors along the pad's axes."""
    place, strength = pad.sensors.position_m, pad.magnet.strength_t_m3

    def residuals(unknowns: Array, field: Array, weight: Array) -> Array:
        r = place - POSITION_UNIT_M * unknowns[:3]
        inverse = 1.0 / (r * r).sum(axis=1)
        third = strength * inverse * np.sqrt(inverse)
        along = 3.0 * third * inverse * (r @ unknowns[3:])
        misfit: Array = weight * ((along[:, None] * r - third[:, None] * unknowns[3:]).ravel() - field)
        return misfit

    def jacobian(unknowns: Array, field: Array, weight: Array) -> Array:
        r = place - POSITION_UNIT_M * unknowns[:3]
        inverse = 1.0 / (r * r).sum(axis=1)
        third = strength * inverse * np.sqrt(inverse)
        fifth = (3.0 * third * inverse)[:, None, None]
        dot = r @ unknowns[3:]
        outer, mixed = r[:, :, None] * r[:, None, :], r[:, :, None] * unknowns[3:]
        columns = np.empty((len(place), 3, 6))
        columns[:, :, 3:] = fifth * outer - third[:, None, None] * np.eye(3)
        columns[:, :, :3] = (POSITION_UNIT_M * fifth) * (
            (5.0 * dot * inverse)[:, None, None] * outer
            - mixed
            - mixed.transpose(0, 2, 1)
            - dot[:, None, None] * np.eye(3)
        )
        return weight[:, None] * columns.reshape(-1, 6)

    def asked(problem: Problem) -> tuple[Array, tuple[Array, Array]]:
        start = np.concatenate([problem.start.position_m / POSITION_UNIT_M, problem.start.axis])
        return start, (problem.measurements[:, VALUE], 1.0 / problem.measurements[:, NOISE])

    def by_leastsq(problem: Problem) -> object:
        start, data = asked(problem)
        return leastsq(residuals, start, args=data, Dfun=jacobian, full_output=True)

    def by_least_squares(method: str, **derivative: object) -> Callable[[Problem], object]:
        def solve(problem: Problem) -> object:
            start, data = asked(problem)
            return least_squares(residuals, start, args=data, method=method, **derivative)

        return solve

    return {
        "scipy.optimize.leastsq with Jacobian": by_leastsq,
        "scipy.optimize.least_squares with Jacobian": by_least_squares("lm", jac=jacobian),
        "scipy.optimize.least_squares without": by_least_squares("lm"),
        "scipy.optimize.least_squares trf with Jacobian": by_least_squares("trf", jac=jacobian),
        "scipy.optimize.least_squares trf without": by_least_squares("trf"),
    }
