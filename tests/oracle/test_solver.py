"""The compiled solver against SciPy and the potential: derivatives, answers, covariance, NEES and coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.special import chdtri as chi2_of_tail

from fmfts.pose import STOP_CONVERGED, Motion, Prior, Problem, State, Status, parts_of, solve_problem
from fmfts.pose.kernel import deviations, predict
from fmfts.pose.problem import MEASUREMENT
from fmfts.pose.state import Neighbour
from kernel.problems import random_problem
from oracle.field import Array, OneMagnet, reading
from oracle.judged import is_too_uncertain, judged, pose_of
from oracle.problems import Pose, covariance, information, solved

NOISE_T = 2e-7
POSE, FIELD, ALL = [0, 1, 2, 3, 4], [0, 1, 2, 3, 4, 6, 7, 8], list(range(14))


def unit(random: np.random.Generator) -> Array:
    vector = random.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def random_pose(
    seed: int, sensors: int = 4, neighbours: int = 0, octupole: bool = True, noise: float = 1.0
) -> tuple[Pose, Array]:
    """A start, and the step from there to the true state whose field is measured."""
    random = np.random.default_rng(seed)
    place = np.repeat(random.uniform([-12e-3, -12e-3, -2e-3], [12e-3, 12e-3, 2e-3], (sensors, 3)), 3, axis=0)
    direction = np.linalg.qr(random.normal(size=(sensors, 3, 3)))[0].reshape(-1, 3)
    kappa = 2.5e-7 if octupole else 0.0
    own = OneMagnet(
        random.uniform([-2e-3, -2e-3, 9e-3], [2e-3, 2e-3, 14e-3]), unit(random), 0.05 * random.normal(), 6.15e-10, kappa
    )
    others = [
        OneMagnet(np.array([0, 0, 12e-3]) + 35e-3 * unit(random), unit(random), 0.0, 6.15e-10, kappa)
        for _ in range(neighbours)
    ]
    deviation = NOISE_T * random.uniform(0.5, 2.0, 3 * sensors)
    start = Pose(
        place,
        direction,
        np.zeros(3 * sensors),
        deviation,
        [own, *others],
        2e-5 * random.normal(size=3),
        1e-5 * random.normal(size=5),
    )
    step = np.zeros(len(start.steps))
    step[:5] = random.normal(size=5) * [1e-4, 1e-4, 1e-4, 0.03, 0.03]
    step[6:9] = random.normal(size=3) * 2e-6
    value = reading(place, direction, *start.stepped(step)) + noise * deviation * random.normal(size=3 * sensors)
    return Pose(place, direction, value, deviation, start.magnets, start.ambient_t, start.gradient_t_per_m), step


def problem_of(pose: Pose, free: list[int], considered: list[int] = [], prior: Array | None = None) -> Problem:  # noqa: B006
    rows = np.zeros((len(pose.value_t), MEASUREMENT))
    rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7] = pose.place_m, pose.direction, pose.value_t, pose.deviation_t
    own, *others = pose.magnets
    neighbours = tuple(Neighbour(one.position_m, one.axis, one.log_moment) for one in others)
    start = State(own.position_m, own.axis, own.log_moment, pose.ambient_t, pose.gradient_t_per_m, neighbours)
    magnets = np.array([(one.strength_t_m3, one.kappa_m2) for one in pose.magnets])
    parts = parts_of(start.columns, **{"free" if prior is None else "prior": free, "considered": considered})
    told = None if prior is None else Prior(start, prior)
    return Problem(rows, magnets, parts, start, told, stop_chi2=STOP_CONVERGED, max_iterations=200)


def prior_of(random: np.random.Generator, pose: Pose) -> Array:
    deviation = np.array(
        [2e-4] * 3
        + [0.05] * 2
        + [0.02]
        + [5e-6] * 3
        + [5e-5] * 5
        + [3e-4, 3e-4, 3e-4, 0.05, 0.05, 0.02] * (len(pose.magnets) - 1)
    )
    mixed = np.eye(len(deviation)) + 0.2 * random.normal(size=(len(deviation), len(deviation))) / np.sqrt(
        len(deviation)
    )
    return np.asarray((mixed @ mixed.T) * deviation[:, None] * deviation)


@pytest.mark.parametrize("octupole", [True, False])
@pytest.mark.parametrize("neighbours", [0, 2])
def test_each_derivative_agrees_with_the_potential(neighbours: int, octupole: bool) -> None:
    """Two at a time: the inverse of their covariance is the product of their derivatives. Tilts go together."""
    pose, _ = random_pose(1, 4, neighbours, octupole, noise=0.0)
    columns = len(pose.steps)
    jacobian = 1e3 * pose.jacobian(np.zeros(columns))
    value = reading(pose.place_m, pose.direction, *pose.stepped(np.zeros(columns)))
    sure_t = 1e-3 * pose.deviation_t  # no unknown of a pair is too uncertain to be published
    at = Pose(pose.place_m, pose.direction, value, sure_t, pose.magnets, pose.ambient_t, pose.gradient_t_per_m)
    for first in range(columns):
        for second in range(first):
            pair = sorted({second, first} | {3, 4} if {second, first} & {3, 4} else {second, first})
            for tilts in ({17, 18}, {23, 24}):
                pair = sorted({*pair} | tilts) if {*pair} & tilts else pair
            told = solve_problem(problem_of(at, pair)).covariance[np.ix_(pair, pair)]
            normal = jacobian[:, pair].T @ jacobian[:, pair]
            wanted = np.linalg.inv(normal)
            # What differences of fourth order leave is 1e-8 of a derivative; a pair may be nearly parallel.
            deviation = np.sqrt(np.diag(wanted))
            assert (np.abs(told - wanted) < 1e-5 * deviation[:, None] * deviation).all(), pair


@pytest.mark.parametrize("neighbours", [0, 2])
def test_prediction_agrees_with_the_potential(neighbours: int) -> None:
    pose, _ = random_pose(2, 4, neighbours)
    problem, at = problem_of(pose, [0]), np.zeros(len(pose.steps))
    value_t, by_step = predict(problem.measurements, problem.magnets, problem.start)
    assert value_t == pytest.approx(reading(pose.place_m, pose.direction, *pose.stepped(at)), rel=1e-12)
    wanted = pose.deviation_t[:, None] * pose.jacobian(at)
    assert (np.abs(by_step - wanted) < 1e-7 * np.abs(wanted).max(axis=0)).all()


def test_deviations_of_old_samples_combine_noise_and_motion() -> None:
    pose, _ = random_pose(3)
    problem, random = problem_of(pose, [0]), np.random.default_rng(3)
    rows = problem.measurements
    rows[:, 8], rows[:, 9], rows[4, 6] = 1e-3, random.uniform(0.0, 2e-3, len(rows)), np.nan
    motion = Motion(random.normal(size=14) * 1e-3, random.uniform(size=14) * 1e-6)
    problem = replace(problem, motion=motion)
    told = deviations(problem)
    assert told is not None
    assert np.flatnonzero(np.isinf(told)).tolist() == [4]
    assert told[np.isfinite(told)] == pytest.approx(pose_of(problem, problem.start).deviation_t, rel=1e-6)
    rows[0, 7] = 0.0
    assert deviations(problem) is None


@pytest.mark.parametrize("seed", range(12))
def test_answer_and_covariance_agree_with_scipy(seed: int) -> None:
    random = np.random.default_rng(seed)
    pose, _ = random_pose(100 + seed, sensors=4 + seed % 3, neighbours=seed % 2, octupole=seed % 3 > 0)
    free = POSE if seed % 4 == 0 else FIELD
    prior, considered = None, list[int]()
    if seed % 2:
        free, considered, prior = [*FIELD, *range(14, 20)], [5], prior_of(random, pose)
    told = solve_problem(problem_of(pose, free, considered, prior))
    assert told.status is Status.CONVERGED
    unlinked = None
    if prior is not None:  # the estimate holds what is considered: given it, the prior of the others is narrower
        cross = prior[np.ix_(free, considered)] @ np.linalg.inv(prior[np.ix_(considered, considered)])
        unlinked = prior.copy()
        unlinked[np.ix_(free, free)] -= cross @ prior[np.ix_(considered, free)]
    step, chi2 = solved(pose, free, unlinked)
    magnets, ambient, gradient = pose.stepped(step)
    there = Pose(pose.place_m, pose.direction, pose.value_t, pose.deviation_t, magnets, ambient, gradient)
    J = there.jacobian(0.0 * step)
    normal = J.T @ J + information(prior, len(step), [*free, *considered])
    wanted = covariance(normal, free, considered, prior)
    deviation = np.sqrt(np.diag(wanted))
    assert np.abs(told.state.position_m - magnets[0].position_m).max() < 1e-4 * deviation[:3].min()
    assert np.abs(told.state.axis - magnets[0].axis).max() < 1e-4 * deviation[3:5].min()
    assert np.abs(told.state.ambient_t - ambient).max() <= 1e-4 * deviation[6:9].max()
    if prior is None:
        assert told.chi2 == pytest.approx(chi2, rel=1e-6)
        assert np.abs(told.covariance - wanted).max() <= 1e-4 * np.outer(deviation, deviation).max()
    used = [*free, *considered]
    share = np.outer(deviation, deviation)[np.ix_(used, used)]
    # A prior's tangent plane is the start's, the answer's is another: the second order of a turn by 0.1.
    assert (np.abs(told.covariance - wanted)[np.ix_(used, used)] <= (1e-4 if prior is None else 2e-2) * share).all()


@pytest.mark.parametrize("sensors", range(3, 9))
@pytest.mark.parametrize("neighbours", range(3))
def test_any_part_may_have_any_role_and_samples_any_age(sensors: int, neighbours: int) -> None:
    """The search ends in the minimum, with its covariance and χ², or where too little is measured."""
    unobservable = 0
    for seed in range(12):
        problem = random_problem(1000 * sensors + 100 * neighbours + seed, sensors, neighbours, seed % 2 == 0)
        told = solve_problem(problem)
        wanted = judged(problem, told.state)
        if is_too_uncertain(problem, told.state, wanted.deviation):
            assert told.status is Status.UNOBSERVABLE
            unobservable += 1
            continue
        # Without a limit but rounding, rounding decides whether the last of all steps is one too many.
        assert told.status in (Status.CONVERGED, Status.AT_LIMIT)
        deviation = np.sqrt(np.diag(wanted.covariance))
        assert (np.abs(wanted.left) <= 1e-4 * deviation).all()
        assert (np.abs(told.covariance - wanted.covariance) <= 1e-5 * deviation[:, None] * deviation).all()
        assert told.chi2 == pytest.approx(wanted.chi2, rel=1e-6, abs=1e-6)
        pose = pose_of(problem, told.state)
        missed = pose.residual(np.zeros(told.state.columns)) * pose.deviation_t
        assert told.residual_t == pytest.approx(np.sqrt(np.mean(missed**2)), rel=1e-6)
        assert (told.rows, told.unknowns) == (len(missed), np.count_nonzero(problem.parts == 1))
        moved = np.abs(told.state.step_from(problem.start))
        assert moved[problem.parts == 0].max(initial=0.0) < 1e-15
    assert unobservable < 3


LINEAR = {
    "6 free": parts_of(free=[0, 1, 2, 3, 4, 5]),
    "8 free": parts_of(free=FIELD),
    "moment free, ambient under a prior": parts_of(free=[0, 1, 2, 3, 4, 5], prior=[6, 7, 8]),
    "one ambient component free, one under a prior": parts_of(free=[*POSE, 6], prior=[8]),
}


@pytest.mark.parametrize("roles", LINEAR)
def test_cold_start_fits_axis_moment_and_field_to_its_position(roles: str) -> None:
    """Of a dipole slightly off its place: no other axis, moment and field fit as well."""
    parts = LINEAR[roles]
    for seed in range(8):
        random = np.random.default_rng(seed)
        pose, _ = random_pose(300 + seed, octupole=False)
        expected = pose.ambient_t + 1e-6 * random.normal(size=3)
        problem = problem_of(pose, [])
        start = replace(problem.start, position_m=pose.magnets[0].position_m + 3e-4 * random.normal(size=3))
        prior = Prior(replace(start, ambient_t=expected), np.diag(np.full(14, 1e-6**2)))
        asked = replace(problem, parts=parts, start=start, prior=prior, project=True)
        told = solve_problem(replace(asked, max_iterations=0))
        assert told.status is Status.AT_LIMIT
        assert np.array_equal(told.state.position_m, start.position_m)
        linear = replace(asked, parts=np.where(np.arange(14) < 3, 0, parts).astype(np.uint8))
        best = min(ended(linear, told.state, axis) for axis in (told.state.axis, *(unit(random) for _ in range(6))))
        assert told.chi2 == pytest.approx(best, rel=1e-7)
        assert (np.abs(judged(linear, told.state).left) <= 1e-4 * judged(linear, told.state).deviation).all()
        found = solve_problem(asked)
        assert found.status is Status.CONVERGED
        assert (np.abs(judged(asked, found.state).left) <= 1e-4 * judged(asked, found.state).deviation).all()


def ended(problem: Problem, state: State, axis: Array) -> float:
    """χ² where SciPy's search from another axis ends."""
    pose = pose_of(problem, replace(state, axis=axis))
    free = np.flatnonzero(np.isin(problem.parts, (1, 3))).tolist()
    assert problem.prior is not None
    told = np.flatnonzero(problem.parts == 3).tolist()
    deviation, off = np.sqrt(np.diag(problem.prior.covariance)), state.ambient_t - problem.prior.mean.ambient_t
    scale = pose.steps[free] * 1e2

    def residual(unknown: Array) -> Array:
        step = np.zeros(14)
        step[free] = unknown * scale
        held = [(step[column] + off[column - 6]) / deviation[column] for column in told]
        return np.concatenate([pose.residual(step), held])

    found = least_squares(residual, np.zeros(len(free)), method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return float(2.0 * found.cost)


@pytest.mark.parametrize(("free", "name"), [(POSE, "pose"), (FIELD, "pose and ambient field")])
def test_errors_over_random_pads_agree_with_the_covariance(free: list[int], name: str) -> None:
    """NEES and χ² of 400 pads, each with another geometry, pose and noise: sums of χ² are within their 1e-6 quantiles;
    coverage of one and two deviations is within five of its own."""
    nees, chi2, inside, count = 0.0, 0.0, np.zeros(2), 400
    rows = 0
    for seed in range(count):
        pose, truth = random_pose(1000 + seed, sensors=5)
        if free is POSE:
            start = pose.stepped(np.concatenate([np.zeros(6), truth[6:9], np.zeros(5)]))
            pose = Pose(pose.place_m, pose.direction, pose.value_t, pose.deviation_t, start[0], start[1], start[2])
        told = solve_problem(problem_of(pose, free))
        assert told.status is Status.CONVERGED
        magnets, ambient, gradient = pose.stepped(np.concatenate([truth[:6], np.zeros(8)]) if free is POSE else truth)
        true = State(magnets[0].position_m, magnets[0].axis, magnets[0].log_moment, ambient, gradient)
        off = told.state.step_from(true)[free]
        own = told.covariance[np.ix_(free, free)]
        nees += off @ np.linalg.solve(own, off)
        chi2 += told.chi2
        rows += told.rows - len(free)
        inside += [np.mean(np.abs(off) < times * np.sqrt(np.diag(own))) for times in (1.0, 2.0)]
    for total, freedom in ((nees, count * len(free)), (chi2, rows)):
        low, high = chi2_of_tail(freedom, [1.0 - 1e-6, 1e-6])
        assert low < total < high
    for share, wanted in zip(inside / count, (0.6827, 0.9545), strict=True):
        assert abs(share - wanted) < 5.0 * np.sqrt(wanted * (1.0 - wanted) / count)


def test_considered_moment_covers_the_error_it_causes() -> None:
    """2 % of the moment, drawn anew for each of 300 pads and unknown to the solver: the covariance covers it."""
    nees, count = 0.0, 300
    for seed in range(count):
        random = np.random.default_rng(seed)
        pose, truth = random_pose(5000 + seed, sensors=5, noise=0.0)
        truth[5] = 0.02 * random.normal()
        value = reading(pose.place_m, pose.direction, *pose.stepped(truth)) + pose.deviation_t * random.normal(size=15)
        measured = Pose(
            pose.place_m, pose.direction, value, pose.deviation_t, pose.magnets, pose.ambient_t, pose.gradient_t_per_m
        )
        prior = np.diag(np.full(14, 1e6))
        prior[5, 5] = 0.02**2
        told = solve_problem(problem_of(measured, FIELD, [5], prior))
        magnets, ambient, gradient = pose.stepped(truth)
        true = State(magnets[0].position_m, magnets[0].axis, magnets[0].log_moment, ambient, gradient)
        used = [*FIELD, 5]
        off = told.state.step_from(true)[used]
        nees += off @ np.linalg.solve(told.covariance[np.ix_(used, used)], off)
    low, high = chi2_of_tail(count * 9, [1.0 - 1e-6, 1e-6])
    assert low < nees < high
