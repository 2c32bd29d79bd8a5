"""Cold starts: wherever the magnet is and however it points, it is found, or said not to be."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.common.chi2 import quantile
from fmfts.pad import Pad
from fmfts.pose import (
    FREE_FIELD,
    FREE_PAPER,
    Problem,
    State,
    Status,
    acquire,
    parts_of,
)
from fmfts.pose.acquisition import starts_in_box
from fmfts.pose.kernel import predict
from fmfts.pose.problem import VALUE, magnet_rows, measurement_rows

NOISE_T = 2e-7
DRAWS = 300


def problem_of(truth: State, pad: Pad, free: np.ndarray, sensors: int, random: np.random.Generator) -> Problem:
    """Noisy readings of `truth` by the first `sensors` sensors, started from the pad's rest."""
    rows = measurement_rows(np.zeros((4, 3)), pad.sensors, NOISE_T)[: 3 * sensors]
    magnets = magnet_rows(pad.magnet, octupole=True)
    rows[:, VALUE] = predict(rows, magnets, truth)[0] + random.normal(0.0, NOISE_T, len(rows))
    return Problem(rows, magnets, parts_of(free=free), State.at_rest(pad))


def anywhere(random: np.random.Generator, ambient: bool) -> State:
    """In a workspace twice as wide as a pad's, the axis in any direction, the Earth's field if there is any."""
    axis = random.normal(size=3)
    field = random.uniform(-5e-5, 5e-5, 3) if ambient else np.zeros(3)
    position = random.uniform([-2e-3, -2e-3, 7.25e-3], [2e-3, 2e-3, 14.25e-3])
    return State(position, axis / np.linalg.norm(axis), 0.0, field)


@pytest.mark.parametrize("sensors", [4, 3])
@pytest.mark.parametrize("free", [FREE_PAPER, FREE_FIELD], ids=["6", "8"])
def test_every_cold_start_is_right_or_flagged(pad: Pad, free: np.ndarray, sensors: int) -> None:
    """`python -m fmfts_lab.bench convergence` does it a million times."""
    random = np.random.default_rng(11)
    flagged = 0  # three sensors cannot distinguish some poses while nothing is known about the ambient field
    for _ in range(DRAWS):
        truth = anywhere(random, ambient=len(free) == 8)
        problem = problem_of(truth, pad, free, sensors, random)
        limit = quantile(1e-6, 3 * sensors - len(free))
        places = np.concatenate([random.uniform([-2e-3, -2e-3, 7e-3], [2e-3, 2e-3, 14e-3], (1, 3)), STARTS])
        found = acquire(problem, places, limit)
        best = found.best
        if best.status is not Status.CONVERGED or best.chi2 > limit or found.rivals or found.bent:
            flagged += 1
            continue
        step = truth.step_from(best.state)[free]
        assert step @ np.linalg.solve(best.covariance[np.ix_(free, free)], step) < 60  # χ²₈ > 60: once in 2e9
    assert flagged <= (0.06 if (sensors, len(free)) == (3, 8) else 0.0) * DRAWS


def test_deviations_in_a_curved_field_are_flagged(pad: Pad) -> None:
    """A reading of the million cold starts: one minimum, χ² fits, and the magnet is far outside its deviations."""
    truth = State(np.array([-1.732e-3, 0.821e-3, 8.296e-3]), np.array([-0.0318, -0.5387, 0.8419]), 0.0, np.zeros(3))
    problem = problem_of(truth, pad, FREE_FIELD, 3, np.random.default_rng(0))
    problem.measurements[:, VALUE] = [
        *(-2.941508411e-04, -1.378282428e-04, 6.291539746e-05),
        *(-4.991095632e-05, 1.087978792e-04, -1.195767692e-04),
        *(3.887178046e-04, -2.994874879e-04, 2.249318132e-04),
    ]
    found = acquire(problem, STARTS, quantile(1e-6, 1))
    assert found.best.status is Status.CONVERGED
    away = truth.position_m - found.best.state.position_m
    assert away @ np.linalg.solve(found.best.covariance[:3, :3], away) > quantile(1e-6, 3)
    assert found.bent


def test_four_sensors_at_work_are_not_flagged_as_bent(pad: Pad) -> None:
    random = np.random.default_rng(16)
    for _ in range(100):
        problem = problem_of(anywhere(random, ambient=True), pad, FREE_FIELD, 4, random)
        assert not acquire(problem, STARTS, quantile(1e-6, 4)).bent


STARTS = starts_in_box(np.array([0.0, 0.0, 12e-3]), np.full(3, 6e-3))


def test_field_that_no_magnet_makes_is_not_acquired(pad: Pad) -> None:
    random = np.random.default_rng(13)
    for _ in range(20):
        problem = problem_of(State.at_rest(pad), pad, FREE_PAPER, 4, random)
        problem.measurements[:, VALUE] = random.normal(0.0, 1e-4, 12)
        best = acquire(problem, STARTS, quantile(1e-6, 6)).best
        assert best.status is not Status.CONVERGED or best.chi2 > quantile(1e-6, 6)


def test_missing_measurements_are_not_acquired(pad: Pad) -> None:
    problem = problem_of(State.at_rest(pad), pad, FREE_PAPER, 4, np.random.default_rng(14))
    problem.measurements[:, VALUE] = np.nan
    assert acquire(problem, STARTS, 100.0).best.status is Status.UNOBSERVABLE
