"""The compiled pad with several magnets against SciPy's splines, the potential's differences, and least squares."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares
from several_world import NOISE_T, fingers_of, mounting_of, pad_of, response_of

from fmfts.several.field_model import FieldModel, Scene
from fmfts.several.fit import Fitter, Measured
from fmfts.several.free_poses import FARTHEST, HALF_A_PRESS_M, free_poses
from oracle.field import Array, differences
from oracle.presses import FINGER_STEP, Pad

SCENE = Scene(ambient_t=2e-5, moment=1e-3, friction=0.3)
SIZES = [(4, 8, 2), (2, 9, 3)]


def pads(magnets: int, sensors: int, terms: int) -> tuple[FieldModel, Pad]:
    random = np.random.default_rng(magnets)
    drawn = pad_of(random, magnets, sensors)
    model = FieldModel(drawn, mounting_of(random, drawn, 20), response_of(random, drawn, 10, terms), SCENE)
    return model, Pad(model, np.array([one.rest_position_m for one in drawn.magnets]))


def near(told: Array, wanted: Array, share: float) -> None:
    """Within a share of each column's largest value: the error of differences."""
    size = np.abs(wanted).max(axis=0)
    assert (np.abs(told - wanted) <= share * size + 1e-300).all(), float((np.abs(told - wanted) / size).max())


@pytest.mark.parametrize("sizes", SIZES)
def test_field_and_each_derivative_are_tables_and_potentials(sizes: tuple[int, int, int]) -> None:
    model, oracle = pads(*sizes)
    random = np.random.default_rng(2)
    for count in (0, 1, 2, 3):
        fingers = fingers_of(random, count)
        told, change = model.predict(fingers), oracle.change(fingers)
        near(told.change, change, 1e-7)
        rest = oracle.field_t(np.zeros_like(change))
        near(told.field_t, oracle.field_t(change) - rest, 1e-7) if count else near(told.field_t, 0.0 * rest, 0.0)
        near(told.by_pose, oracle.by_pose(change), 1e-6)
        for one, finger in zip(told.pressed, fingers, strict=True):
            near(one.change, oracle.alone(finger), 1e-10)
            near(one.slope, differences(oracle.alone, finger, FINGER_STEP), 1e-7)
            near(one.laplacian, oracle._curvature(finger, 0) + oracle._curvature(finger, 1), 1e-5)
        if count:
            near(told.slope, oracle.by_finger(fingers), 1e-6)


@pytest.mark.parametrize("sizes", SIZES)
def test_covariance_of_the_field_is_the_sum_of_its_causes(sizes: tuple[int, int, int]) -> None:
    model, oracle = pads(*sizes)
    random = np.random.default_rng(3)
    for count in (0, 1, 2):
        fingers, ambient = fingers_of(random, count), random.normal(0.0, 2e-5, 3)
        variance = NOISE_T**2 * random.uniform(0.5, 2.0, 3 * sizes[1])
        told = model.covariance(fingers, model.predict(fingers), variance, ambient)
        wanted = oracle.covariance(fingers, variance, ambient)
        deviation = np.sqrt(np.diag(wanted))
        assert np.abs((told - wanted) / np.outer(deviation, deviation)).max() < 1e-5


@pytest.mark.parametrize("sizes", SIZES)
def test_fingers_and_their_deviations_are_those_of_least_squares(sizes: tuple[int, int, int]) -> None:
    model, oracle = pads(*sizes)
    fitter, random = Fitter(model), np.random.default_rng(4)
    for count in (1, 2):
        true = fingers_of(random, 1) if count == 1 else np.array([[-7.0, 2.0, 0.9], [6.0, -3.0, 1.1]])
        measured = measured_of(random, oracle, oracle.change(true), 3 * sizes[1])
        fit = fitter.fit(true + random.normal(0.0, [0.5, 0.5, 0.1], true.shape), measured, np.zeros(3))
        C = oracle.covariance(fit.fingers, measured.variance_t2, np.zeros(3))
        L = cholesky(C, lower=True)
        rest = oracle.field_t(np.zeros(5 * sizes[0]))

        def residual(unknown: Array, root: Array = L, rest: Array = rest, measured: Measured = measured) -> Array:
            predicted = oracle.field_t(oracle.change(unknown.reshape(-1, 3))) - rest
            return np.asarray(solve_triangular(root, measured.field_t - predicted, lower=True))

        found = least_squares(residual, true.ravel(), x_scale=np.tile([1.0, 1.0, 0.1], count), xtol=1e-10, ftol=1e-12)
        J = solve_triangular(L, oracle.by_finger(fit.fingers), lower=True)
        wanted = np.linalg.inv(J.T @ J)
        deviation = np.sqrt(np.diag(wanted))
        # The search ends where a step is below 0.03 deviations.
        assert (np.abs(fit.fingers.ravel() - found.x) < 0.05 * deviation).all()
        assert np.abs((fit.covariance - wanted) / np.outer(deviation, deviation)).max() < 1e-4
        white = residual(fit.fingers.ravel())
        assert fit.chi2 == pytest.approx(white @ white, rel=1e-5)
        A = oracle.model.mounting.sensors.axes.transpose(0, 2, 1).reshape(-1, 3)
        misfit = measured.field_t - (oracle.field_t(oracle.change(fit.fingers)) - rest)
        assert fit.ambient_t == pytest.approx(
            SCENE.ambient_t**2 * A.T @ np.linalg.solve(C, misfit), rel=1e-4, abs=1e-11
        )


def measured_of(random: np.random.Generator, oracle: Pad, change: Array, values: int) -> Measured:
    field = oracle.field_t(change) - oracle.field_t(np.zeros_like(change)) + random.normal(0.0, NOISE_T, values)
    return Measured(field, np.full(values, NOISE_T**2), np.ones(values, bool))


def test_free_poses_and_their_deviations_are_those_of_least_squares() -> None:
    model, oracle = pads(2, 9, 3)
    random = np.random.default_rng(5)
    true = random.normal(0.0, np.tile([1e-4, 1e-4, 1e-4, 0.03, 0.03], 2))
    measured = measured_of(random, oracle, true, 27)
    told = free_poses(model, np.zeros(10), measured, np.zeros(3))
    # The baseline's errors are known for a magnet half a press down; a dipole's gradient changes as r⁻⁵.
    counted, base_m = told.change.copy().reshape(2, 5), model.mounting.sensors.position_m[:, 2].mean()
    for row, place in zip(counted, model.mounting.magnets.position_m, strict=True):
        above_m = place[2] - base_m
        row *= ((above_m - HALF_A_PRESS_M) / (above_m + 0.5 * min(row[2], 0.0))) ** 5
    A = model.mounting.sensors.axes.transpose(0, 2, 1).reshape(-1, 3)
    m = oracle.field_t(told.change)[:, None]
    E = model.mounting.errors.at(counted.ravel(), np.zeros(3))
    C = np.diag(measured.variance_t2) + SCENE.ambient_t**2 * A @ A.T + SCENE.moment**2 * m @ m.T + E @ E.T
    L, rest = cholesky(C, lower=True), oracle.field_t(np.zeros(10))

    def residual(change: Array) -> Array:
        return np.asarray(solve_triangular(L, measured.field_t - (oracle.field_t(change) - rest), lower=True))

    scale = np.tile([1e-4, 1e-4, 1e-4, 0.02, 0.02], 2)
    found = least_squares(lambda unknown: residual(unknown * scale), true / scale, xtol=1e-12, ftol=1e-14).x * scale
    J = differences(residual, told.change, scale * 1e-2)
    wanted = np.linalg.inv(J.T @ J + np.diag(1.0 / np.tile(FARTHEST, 2) ** 2))
    deviation = np.sqrt(np.diag(wanted))
    assert (np.abs(told.change - found) < 0.1 * deviation).all()
    assert np.abs((told.covariance - wanted) / np.outer(deviation, deviation)).max() < 1e-4
    white = residual(told.change)
    assert told.chi2 == pytest.approx(white @ white, rel=1e-4)
