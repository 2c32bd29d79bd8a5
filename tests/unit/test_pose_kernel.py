"""What the compiled solver says of one pad: what it cannot tell, what a prior and a held part do, and batches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmfts.pad import Pad
from fmfts.pose import (
    STOP_CONVERGED,
    Prior,
    State,
    Status,
    parts_of,
    tangent_basis,
)
from fmfts.pose.kernel import Batch, _kernel, predict, solve_problem
from fmfts.pose.problem import (
    NOISE,
    VALUE,
)
from fmfts.pose.state import AXIS, SIZE
from kernel.problems import NOISE_T, TRUTH, problem_at


def test_nine_unknowns_at_rest_name_what_trades_off(pad: Pad) -> None:
    rest = State.at_rest(pad)
    solution = solve_problem(problem_at(pad, rest, parts=parts_of(free=np.arange(9))))
    assert solution.status is Status.UNOBSERVABLE
    assert set(solution.unobservable) == {"z", "moment", "ambient z"}
    assert np.isnan(solution.covariance).all()
    # And it is one: along it, the twelve readings do not change.
    problem = problem_at(pad, rest)
    _, jacobian = predict(problem.measurements, problem.magnets, rest)
    scale = np.where(solution.direction == 0.0, 1.0, np.linalg.norm(jacobian / NOISE_T, axis=0))
    assert np.linalg.norm(jacobian / NOISE_T @ (solution.direction / scale)) < 1e-6


def test_height_known_to_half_a_centimetre_is_unobservable(pad: Pad) -> None:
    """The bound there is 4.95 mm, of 16 mm to the sensors; where it is 0.8 mm, the answer stands."""
    lateral = State(np.array([0.3e-3, 0.0, 12e-3]), np.array([0.05, 0.0, 1.0]) / np.hypot(0.05, 1.0), 0.0, np.zeros(3))
    parts = parts_of(free=np.arange(9))
    solution = solve_problem(problem_at(pad, lateral, parts=parts, max_iterations=0))
    assert solution.status is Status.UNOBSERVABLE
    assert "z" in solution.unobservable
    pressed = State(np.array([0.5e-3, 0.3e-3, 10.5e-3]), np.array([0.1, 0.05, 0.99]), 0.0, np.zeros(3))
    pressed = replace(pressed, axis=pressed.axis / np.linalg.norm(pressed.axis))
    solution = solve_problem(problem_at(pad, pressed, parts=parts))
    assert solution.status is Status.CONVERGED
    assert np.sqrt(solution.covariance[2, 2]) == pytest.approx(827e-6, rel=0.01)


def test_one_sensor_alone_is_unobservable(pad: Pad) -> None:
    problem = problem_at(pad)
    solution = solve_problem(replace(problem, measurements=problem.measurements[:3]))
    assert solution.status is Status.UNOBSERVABLE


def test_search_that_may_not_go_on_says_so(pad: Pad) -> None:
    far = TRUTH.stepped(np.array([1e-3, 0, 1e-3, 0.2, 0.2]))
    solution = solve_problem(replace(problem_at(pad), start=far, max_iterations=1))
    assert solution.status is Status.AT_LIMIT
    assert np.isfinite(solution.covariance).all()


def test_considered_moment_widens_covariance_and_is_not_updated(pad: Pad) -> None:
    sure = solve_problem(problem_at(pad))
    covariance = np.zeros((SIZE, SIZE))
    covariance[5, 5] = 0.02**2
    parts = parts_of(free=[0, 1, 2, 3, 4, 6, 7, 8], considered=5)
    held = solve_problem(problem_at(pad, parts=parts, prior=Prior(TRUTH, covariance)))
    assert held.state.log_moment == TRUTH.log_moment
    assert held.covariance[5, 5] == pytest.approx(0.02**2, rel=1e-12)
    # The estimate's shift per unit of moment, by solving again with another moment: linear to its curvature.
    shifted = solve_problem(problem_at(pad, start=replace(TRUTH, log_moment=TRUTH.log_moment + 1e-6)))
    slope = shifted.state.step_from(sure.state)[:9] / 1e-6
    assert held.covariance[:9, 5] == pytest.approx(slope * 0.02**2, rel=1e-4, abs=1e-12)
    extra = held.covariance[:5, :5] - sure.covariance[:5, :5]
    assert extra == pytest.approx(np.outer(slope[:5], slope[:5]) * 0.02**2, rel=1e-4, abs=1e-14)


def test_prior_from_one_frame_makes_the_next_twice_as_good(pad: Pad) -> None:
    """Two frames fused by the prior equal both solved at once, in the state and in its covariance."""
    random = np.random.default_rng(3)
    frames = [problem_at(pad), problem_at(pad)]
    for frame in frames:
        frame.measurements[:, VALUE] += random.normal(0.0, NOISE_T, 12)
    first = solve_problem(frames[0])
    after = parts_of(prior=[0, 1, 2, 3, 4, 6, 7, 8])
    chained = solve_problem(
        replace(frames[1], parts=after, prior=Prior(first.state, first.covariance), start=first.state)
    )
    both = solve_problem(replace(frames[0], measurements=np.concatenate([frame.measurements for frame in frames])))
    deviation = np.sqrt(np.diagonal(both.covariance))[:9]
    # The prior is the first frame's posterior only as far as that is Gaussian: curvature over a deviation of 1e-3.
    assert (np.abs(chained.state.step_from(both.state)[:9]) <= 0.01 * deviation + 1e-15).all()
    assert chained.covariance == pytest.approx(both.covariance, rel=0.02, abs=0.002 * float(np.max(both.covariance)))
    assert chained.degrees_of_freedom == 12


def test_prior_is_transported_to_where_the_axis_is(pad: Pad) -> None:
    """A prior that knows one tilt and not the other still knows that one after the basis has flipped at z = 0."""
    flat = replace(TRUTH, axis=np.array([0.6, 0.8, 0.0]))
    mean = flat.stepped(np.array([0.0, 0.0, 0.0, 0.02, -0.01]))
    known = np.array([0.8, -0.6, 0.0])
    for origin in (mean, mean.stepped(-mean.step_from(flat) * 2.0)):
        basis = tangent_basis(origin.axis)
        along = basis.T @ known / np.linalg.norm(basis.T @ known)
        tilt = np.eye(2) * 1e-2 - np.outer(along, along) * (1e-2 - 1e-10)
        covariance = np.eye(SIZE)
        covariance[AXIS, AXIS] = tilt
        problem = problem_at(pad, flat, parts=parts_of(free=[0, 1, 2], prior=[3, 4]), start=flat)
        solution = solve_problem(replace(problem, prior=Prior(origin, covariance)))
        own = tangent_basis(solution.state.axis)
        spread = own @ solution.covariance[AXIS, AXIS] @ own.T
        assert known @ spread @ known < 1.1e-10
        assert np.array([0.0, 0.0, 1.0]) @ spread @ np.array([0.0, 0.0, 1.0]) > 1e-7


def test_batch_is_its_single_solves(pad: Pad) -> None:
    random = np.random.default_rng(4)
    problems = [problem_at(pad) for _ in range(5)]
    for problem in problems:
        problem.measurements[:, VALUE] += random.normal(0.0, NOISE_T, 12)
    problems[2].measurements[0, NOISE] = 0.0
    rows = np.stack([problem.measurements for problem in problems])
    batch = Batch.of(rows, problems[0].magnets, problems[0].parts, TRUTH.vector())
    batch.solve(STOP_CONVERGED, 50)
    for index, problem in enumerate(problems):
        alone, together = solve_problem(problem), batch.solution(index)
        assert together.status is alone.status
        assert np.array_equal(together.state.vector(), alone.state.vector())
        assert np.array_equal(together.covariance, alone.covariance, equal_nan=True)


def test_arrays_of_the_wrong_size_are_refused(pad: Pad) -> None:
    problem = problem_at(pad)
    batch = Batch.of(problem.measurements[None], problem.magnets, problem.parts, TRUTH.vector())
    with pytest.raises(ValueError, match="bytes"):
        replace(batch, covariance=np.empty((1, 9, 9))).solve(1e-3, 50)
    crowd = np.tile(problem.magnets, (_kernel.MAX_MAGNETS + 1, 1))
    with pytest.raises(ValueError, match="magnets"):
        replace(batch, magnets=crowd[None]).solve(1e-3, 50)
