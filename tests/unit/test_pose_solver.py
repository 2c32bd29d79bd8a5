from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from fmfts.pad import Pad, SensorArray, rotation_from_vector
from fmfts.pose import (
    FREE_FIELD,
    FREE_PAPER,
    FREE_POSE,
    STOP_CONVERGED,
    State,
    Status,
    dipole_derivatives,
    dipole_field,
    solve,
    tangent_basis,
)

NOISE_T = 2e-7
unit = st.floats(-1.0, 1.0, allow_nan=False)


@st.composite
def states(draw: st.DrawFn) -> State:
    """Anywhere that the magnet of a pad goes: ±1 mm sideways, 9–12.5 mm high, tilted to 45°."""
    position = np.array([draw(unit) * 1e-3, draw(unit) * 1e-3, 10.75e-3 + draw(unit) * 1.75e-3])
    azimuth, tilt = draw(st.floats(0.0, 2 * np.pi)), draw(st.floats(0.0, np.pi / 4))
    axis = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    return State(position, axis, draw(unit) * 0.3, np.zeros(3))


def field_of(state: State, pad: Pad) -> np.ndarray:
    strength = pad.magnet.strength_t_m3 * np.exp(state.log_moment)
    field = dipole_field(pad.sensors.position_m, state.position_m, state.axis, strength) + state.ambient_t
    return pad.sensors.to_sensor(field)


def at(pad: Pad, position_mm: tuple[float, float, float], axis: tuple[float, float, float]) -> State:
    direction = np.array(axis)
    return State(np.array(position_mm) * 1e-3, direction / np.linalg.norm(direction), 0.0, np.zeros(3))


@given(state=states())
def test_noise_free_field_gives_the_state_back(state: State) -> None:
    from fmfts.config import PadConfig, SimulatedSource

    pad = PadConfig(name="standard", source=SimulatedSource()).pad()
    estimate = solve(field_of(state, pad), pad, octupole=False, stop_chi2=STOP_CONVERGED, deviation_t=NOISE_T)
    assert estimate.status is Status.CONVERGED
    assert estimate.position_m == pytest.approx(state.position_m, abs=1e-11)
    assert estimate.axis == pytest.approx(state.axis, abs=1e-9)
    assert estimate.remanence_t == pytest.approx(pad.magnet.remanence_t * np.exp(state.log_moment), rel=1e-8)


@given(state=states(), step=st.lists(unit, min_size=9, max_size=9))
def test_step_from_inverts_stepped(state: State, step: list[float]) -> None:
    scale = np.array([1e-3] * 3 + [0.5] * 2 + [0.3] + [1e-5] * 3)
    there = state.stepped(np.array(step) * scale)
    assert there.step_from(state)[:9] == pytest.approx(np.array(step) * scale, abs=1e-12)
    assert np.linalg.norm(there.axis) == pytest.approx(1.0, abs=1e-15)


@given(state=states())
def test_derivatives_agree_with_finite_differences(state: State) -> None:
    places = np.array([[8e-3, 8e-3, 0.0], [-8e-3, 5e-3, 1e-3]])
    strength = 6.15e-10
    field, by_position, by_axis = dipole_derivatives(places, state.position_m, state.axis, strength)
    assert field == pytest.approx(dipole_field(places, state.position_m, state.axis, strength), rel=1e-12)
    for column in range(3):
        step = np.zeros(3)
        step[column] = 1e-7
        forth = dipole_field(places, state.position_m + step, state.axis, strength)
        back = dipole_field(places, state.position_m - step, state.axis, strength)
        # Central differences are off by the third derivative times step²/6: 1e-9 relative here.
        assert by_position[:, :, column] == pytest.approx((forth - back) / 2e-7, rel=1e-6, abs=1e-9)
        forth = dipole_field(places, state.position_m, state.axis + step, strength)
        back = dipole_field(places, state.position_m, state.axis - step, strength)
        assert by_axis[:, :, column] == pytest.approx((forth - back) / 2e-7, rel=1e-6, abs=1e-12)


@given(state=states())
def test_tangent_basis_is_orthonormal_to_the_axis(state: State) -> None:
    frame = np.column_stack([state.axis, tangent_basis(state.axis)])
    assert frame.T @ frame == pytest.approx(np.eye(3), abs=1e-14)


# The bound for this geometry at 2 mG, computed independently by the Fisher information; µm, rounded to 0.1.
@pytest.mark.parametrize(
    ("free", "position_mm", "axis", "position_um"),
    [
        (FREE_POSE, (0, 0, 12), (0, 0, 1), (8.6, 8.6, 3.5)),
        (FREE_PAPER, (0, 0, 12), (0, 0, 1), (8.6, 8.6, 6.1)),
        (FREE_FIELD, (0, 0, 12), (0, 0, 1), (14.9, 14.9, 3.5)),
        (FREE_PAPER, (0.5, 0.3, 10.5), (0.1, 0.05, 0.99), (6.1, 6.1, 4.4)),
        (FREE_FIELD, (0.707, 0, 11.707), (1, 0, 1), (7.7, 6.0, 4.3)),
    ],
)
def test_covariance_is_the_cramer_rao_bound(pad: Pad, free, position_mm, axis, position_um) -> None:
    truth = at(pad, position_mm, axis)
    estimate = solve(field_of(truth, pad), pad, truth, deviation_t=NOISE_T, free=free)
    deviation_um = np.sqrt(np.diagonal(estimate.covariance)[:3]) * 1e6
    assert deviation_um == pytest.approx(position_um, abs=0.1)


def test_estimates_scatter_as_the_covariance_says(pad: Pad) -> None:
    truth = at(pad, (0.5, 0.3, 10.5), (0.1, 0.05, 0.99))
    field, random = field_of(truth, pad), np.random.default_rng(5)
    nees, chi2 = [], []
    for _ in range(1000):
        estimate = solve(field + random.normal(0.0, NOISE_T, field.shape), pad, truth, deviation_t=NOISE_T)
        step = estimate.state.step_from(truth)[:6]
        nees.append(step @ np.linalg.solve(estimate.covariance[:6, :6], step))
        chi2.append(estimate.chi2)
    # Means of 1000 χ²₆: deviation sqrt(12/1000) = 0.11; four of them.
    assert np.mean(nees) == pytest.approx(6.0, abs=0.44)
    assert np.mean(chi2) == pytest.approx(6.0, abs=0.44)


def test_stopping_rule_leaves_under_a_twentieth_deviation(pad: Pad) -> None:
    truth = at(pad, (0.5, 0.3, 10.5), (0.1, 0.05, 0.99))
    field = field_of(truth, pad) + np.random.default_rng(6).normal(0.0, NOISE_T, (4, 3))
    stopped = solve(field, pad, deviation_t=NOISE_T)
    converged = solve(field, pad, deviation_t=NOISE_T, stop_chi2=STOP_CONVERGED)
    left = stopped.state.step_from(converged.state)[:6]
    assert np.sqrt(left @ np.linalg.solve(converged.covariance[:6, :6], left)) < 0.05
    assert stopped.iterations < converged.iterations


def test_solver_agrees_with_scipy_on_a_noisy_field(pad: Pad) -> None:
    truth = at(pad, (0.7, -0.4, 11.0), (0.3, 0.1, 0.9))
    field = field_of(truth, pad) + np.random.default_rng(7).normal(0.0, 1e-6, (4, 3))

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        predicted = dipole_field(pad.sensors.position_m, unknowns[:3] * 1e-3, unknowns[3:], pad.magnet.strength_t_m3)
        return ((predicted - field) / 1e-6).ravel()

    oracle = least_squares(residuals, [0, 0, 12, 0, 0, 1], method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    estimate = solve(field, pad, deviation_t=1e-6, stop_chi2=STOP_CONVERGED)
    assert estimate.position_m * 1e3 == pytest.approx(oracle[:3], abs=1e-6)
    assert estimate.axis * estimate.remanence_t / 1.23 == pytest.approx(oracle[3:], abs=1e-6)


def test_rotated_sensors_are_rotated_directions(pad: Pad) -> None:
    random = np.random.default_rng(8)
    turned = np.array([rotation_from_vector(vector) for vector in random.normal(0.0, 1.0, (4, 3))])
    rotated = replace(pad, sensors=SensorArray(pad.sensors.position_m, turned))
    truth = at(pad, (0.5, 0.3, 10.5), (0.1, 0.05, 0.99))
    estimate = solve(field_of(truth, rotated), rotated, stop_chi2=STOP_CONVERGED)
    assert estimate.position_m == pytest.approx(truth.position_m, abs=1e-11)


def test_missing_axes_are_left_out_and_cost_certainty(pad: Pad) -> None:
    truth = at(pad, (0.5, 0.3, 10.5), (0.1, 0.05, 0.99))
    field = field_of(truth, pad)
    whole = solve(field, pad)
    field[2, 1] = np.nan
    partial = solve(field, pad, stop_chi2=STOP_CONVERGED)
    assert partial.rows == 11
    assert partial.position_m == pytest.approx(truth.position_m, abs=1e-11)
    assert np.trace(partial.covariance[:3, :3]) > np.trace(whole.covariance[:3, :3])


def test_nine_unknowns_at_rest_are_unobservable_not_far_away(pad: Pad) -> None:
    rest = State.at_rest(pad)
    estimate = solve(field_of(rest, pad), pad, rest, free=np.arange(9))
    assert estimate.status is Status.UNOBSERVABLE
    assert np.isnan(estimate.covariance).all()


@pytest.mark.parametrize("deviation", [0.0, float("nan"), -1e-7])
def test_invalid_deviation_is_refused(pad: Pad, deviation: float) -> None:
    estimate = solve(field_of(State.at_rest(pad), pad), pad, deviation_t=deviation)
    assert estimate.status is Status.INVALID
    assert np.isnan(estimate.remanence_t)


def test_axis_of_infinite_deviation_is_left_out(pad: Pad) -> None:
    field = field_of(State.at_rest(pad), pad)
    deviation = np.full((4, 3), NOISE_T)
    deviation[1, 2] = np.inf
    field[1, 2] = 1.0
    estimate = solve(field, pad, deviation_t=deviation)
    assert estimate.rows == 11
    assert estimate.position_m == pytest.approx(pad.rest_position_m, abs=1e-9)


def test_missing_measurements_give_no_pose(pad: Pad) -> None:
    estimate = solve(np.full((4, 3), np.nan), pad)
    assert estimate.status is Status.UNOBSERVABLE
    assert np.isnan(estimate.chi2)
