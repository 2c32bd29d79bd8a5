"""What the kernel refuses: numbers that are no measurement, start, motion or prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmfts.pad import Pad
from fmfts.pose import Motion, Part, Prior, Status
from fmfts.pose.kernel import solve_problem
from fmfts.pose.problem import AGE, NOISE, PROPORTIONAL, VALUE
from fmfts.pose.state import SIZE
from kernel.problems import TRUTH, problem_at

BAD_ROWS = {
    "zero noise": (NOISE, 0.0),
    "negative noise": (NOISE, -1e-7),
    "noise that is no number": (NOISE, np.nan),
    "noise too large to square": (NOISE, 1e200),
    "noise too small to square": (NOISE, 1e-200),
    "proportional part too large to square": (PROPORTIONAL, 1e200),
    "negative proportional part": (PROPORTIONAL, -0.01),
    "age that is no number": (AGE, np.nan),
    "sample from the future": (AGE, -1e-3),
    "place that is no number": (0, np.nan),
    "infinite place": (1, np.inf),
    "direction that is not unit": (3, 2.0),
}


@pytest.mark.parametrize("what", BAD_ROWS)
def test_row_that_is_no_measurement_is_refused(pad: Pad, what: str) -> None:
    problem = problem_at(pad)
    column, value = BAD_ROWS[what]
    problem.measurements[4, column] = value
    solution = solve_problem(problem)
    assert solution.status is Status.INVALID
    assert np.isnan(solution.covariance).all()
    assert np.isnan([solution.chi2, solution.residual_t]).all()


@pytest.mark.parametrize(("column", "value"), [(VALUE, np.nan), (VALUE, np.inf), (VALUE, -np.inf), (NOISE, np.inf)])
def test_row_that_holds_no_value_is_left_out(pad: Pad, column: int, value: float) -> None:
    problem = problem_at(pad)
    without = replace(problem, measurements=np.delete(problem.measurements, 4, axis=0))
    problem.measurements[4, column] = value
    left_out, absent = solve_problem(problem), solve_problem(without)
    assert left_out.rows == absent.rows == 11
    assert left_out.covariance == pytest.approx(absent.covariance, rel=1e-12)


def test_value_too_large_to_square_is_refused(pad: Pad) -> None:
    problem = problem_at(pad)
    problem.measurements[4, VALUE] = 1e300
    assert solve_problem(problem).status is Status.INVALID


BAD_STARTS = {
    "no number": replace(TRUTH, position_m=np.array([np.nan, 0.0, 0.012])),
    "axis that is not unit": replace(TRUTH, axis=np.array([0.0, 0.0, 1.1])),
    "magnet in a sensor": replace(TRUTH, position_m=np.array([8e-3, 8e-3, 0.0])),
}


@pytest.mark.parametrize("what", BAD_STARTS)
def test_invalid_start_is_refused(pad: Pad, what: str) -> None:
    assert solve_problem(replace(problem_at(pad), start=BAD_STARTS[what])).status is Status.INVALID


NONE, ONE = np.zeros(SIZE), np.eye(SIZE)[6]
BAD_MOTIONS = {
    "diffusion that narrows": Motion(NONE, -1e-12 * ONE),
    "infinite diffusion": Motion(NONE, np.where(ONE > 0.0, np.inf, 0.0)),
    "diffusion that is no number": Motion(NONE, np.nan * ONE),
    "rate that is no number": Motion(np.where(ONE > 0.0, np.nan, 0.0), NONE),
}


@pytest.mark.parametrize("what", BAD_MOTIONS)
def test_invalid_motion_is_refused(pad: Pad, what: str) -> None:
    problem = problem_at(pad)
    problem.measurements[:, AGE] = 1e-3
    assert solve_problem(replace(problem, motion=Motion(NONE, 1e-12 * ONE))).status is Status.CONVERGED
    assert solve_problem(replace(problem, motion=BAD_MOTIONS[what])).status is Status.INVALID


def test_invalid_part_is_refused(pad: Pad) -> None:
    problem = problem_at(pad)
    problem.parts[12] = 7
    assert solve_problem(problem).status is Status.INVALID


@pytest.mark.parametrize("stop_chi2", [0.0, -1.0, np.inf, np.nan])
def test_search_that_would_never_or_always_end_is_refused(pad: Pad, stop_chi2: float) -> None:
    assert solve_problem(problem_at(pad, stop_chi2=stop_chi2)).status is Status.INVALID


@pytest.mark.parametrize("part", [Part.PRIOR, Part.CONSIDERED])
def test_invalid_prior_is_refused(pad: Pad, part: Part) -> None:
    problem = problem_at(pad)
    problem.parts[5] = part
    assert solve_problem(problem).status is Status.INVALID
    for variance in (0.0, -1.0, np.nan, np.inf):
        covariance = np.diag(np.r_[np.ones(5), variance, np.ones(8)])
        assert solve_problem(replace(problem, prior=Prior(TRUTH, covariance))).status is Status.INVALID


def test_noise_of_zero_is_refused_also_beside_proportional_part(pad: Pad) -> None:
    problem = problem_at(pad)
    problem.measurements[:, PROPORTIONAL] = 0.01
    assert solve_problem(problem).status is Status.CONVERGED
    problem.measurements[4, NOISE] = 0.0
    assert solve_problem(problem).status is Status.INVALID
