"""Table inversion: the response is what it says, C does what NumPy does, and an answer gets better by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from examples import examples
from fmfts.contact import ContactModel
from fmfts.contact.beside import told
from fmfts.contact.contract import RESPONSE_KEY, parse_response
from fmfts.contact.refinement import Refiner
from fmfts.contact.response import Response
from fmfts.contact.seal import unsealed
from fmfts.contact.shipped import DEFAULT_PATH
from fmfts.pad import Pad
from fmfts.sensor.chips import NOISE_T
from fmfts_calibrate.fitting import SHEAR_EXPONENTS, fit_response
from fmfts_calibrate.likelihood import invert
from fmfts_calibrate.tracked import FrameSolver
from fmfts_lab.calibration.simulated import pressed_fields, rest_field_of
from oracle.response import change_and_slope, most_likely

Array = NDArray[np.float64]
SHEARED = np.array([(1, 0, 0), (2, 0, 0), (3, 0, 0), *SHEAR_EXPONENTS], dtype=np.intp)


def metadata_of_default() -> dict[str, str]:
    return told(unsealed(DEFAULT_PATH.read_bytes())).metadata


def shipped() -> Response:
    found = parse_response(metadata_of_default())
    assert found is not None
    return found


def sheared(seed: int) -> Response:
    """A response to three loads, its coefficients at random: for comparing two evaluations of it."""
    coefficient = np.random.default_rng(seed).normal(size=(9, 12, len(SHEARED), 5))
    return Response(np.array([-9.0, -12.0]), np.array([3.0, 2.5]), 1.7, SHEARED, coefficient)


RESPONSES = [shipped(), sheared(1)]


@pytest.mark.parametrize("response", RESPONSES, ids=["normal", "sheared"])
def test_slope_is_derivative_also_beyond_calibrated_force(response: Response) -> None:
    random = np.random.default_rng(2)
    place = random.uniform(response.first_mm + 0.1, response.last_mm - 0.1, (60, 2))
    press = np.column_stack(
        [place, random.uniform(0.05, 3.0, (60, 1)), random.normal(0, 0.5, (60, response.loads - 1))]
    )
    _, slope = response.change_and_slope(press)
    for column, step in enumerate(1e-5 * np.eye(press.shape[1])):
        ahead, behind = response.change(press + step), response.change(press - step)
        np.testing.assert_allclose(slope[:, :, column], (ahead - behind) / 2e-5, atol=1e-6 * np.abs(slope).max())


def test_unloaded_pad_is_at_rest_wherever_it_is_not_pressed() -> None:
    press = np.array([[3.0, -2.0, 0.0], [14.0, 14.0, 0.0], [-40.0, 0.0, 0.0]])
    np.testing.assert_array_equal(shipped().change(press), 0.0)


def test_response_is_linear_in_its_coefficients() -> None:
    response = sheared(3)
    press = np.random.default_rng(4).uniform([-9, -12, 0, -0.3, -0.3], [9, 12, 1.7, 0.3, 0.3], (40, 5))
    direct = np.einsum("kijm,ijmc->kc", response.basis(press), response.coefficient)
    np.testing.assert_allclose(response.change(press), direct, rtol=1e-10, atol=1e-12)


def test_fit_meets_a_smooth_response_between_its_points() -> None:
    """Bumps as wide as the pad's, on a grid of 2 mm: cubic splines leave a ten-thousandth."""

    def bump(press: Array) -> Array:
        x, y, force = press.T
        height = np.exp(-(x**2 + y**2) / 60.0) * force * (1.0 - 0.1 * force)
        return np.column_stack([x * height, y * height, -height, x * height / 3.0, y * height / 3.0])

    axis = np.linspace(-14.0, 14.0, 15)
    press = np.array([(x, y, force) for x in axis for y in axis for force in (0.3, 1.1, 2.0)])
    fitted = fit_response(press, bump(press), np.full((len(press), 5), 1e-3))
    new = np.random.default_rng(5).uniform([-13, -13, 0.1], [13, 13, 1.9], (500, 3))
    np.testing.assert_allclose(fitted.change(new), bump(new), atol=1e-3 * np.abs(bump(new)).max())


# --- the kernel ---


@given(
    which=st.sampled_from(range(2)),
    seed=st.integers(0, 2**32 - 1),
    steps=st.integers(0, 6),
    size=st.sampled_from([1e-3, 0.1, 3.0]),
)
@examples(150)
def test_kernel_and_numpy_agree(which: int, seed: int, steps: int, size: float) -> None:
    """To 1e-6 of the larger: rounding grows with the condition of what is inverted, up to 1e9 here."""
    random = np.random.default_rng(seed)
    refiner = Refiner(RESPONSES[which])
    loads = refiner.response.loads
    press = np.concatenate([random.uniform(-15, 15, 2), random.uniform(0, 4, 1), random.normal(0, 1, loads - 1)])
    change = refiner.response.change(press[None])[0] + size * random.normal(size=5) * [0.02, 0.02, 0.02, 0.003, 0.003]
    root = random.normal(size=(5, 5)) * [0.01, 0.01, 0.005, 0.002, 0.002]
    covariance = root.T @ root + np.diag([1e-5, 1e-5, 1e-5, 1e-6, 1e-6])
    start = press + random.normal(0, 1, len(press)) * 0.5
    ours, our_spread, our_chi2 = refiner.refined(start, change, covariance, steps)
    theirs, their_spread, their_chi2 = most_likely(refiner.response, change[None], covariance[None], start[None], steps)
    np.testing.assert_allclose(ours, theirs[0], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(our_spread, their_spread[0], rtol=1e-5, atol=1e-6 * np.abs(their_spread).max())
    np.testing.assert_allclose(our_chi2, their_chi2[0], rtol=1e-6, atol=1e-9)
    for found, expected in zip(
        refiner.response.change_and_slope(press[None]), change_and_slope(refiner.response, press[None]), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())


def test_kernel_refuses_what_does_not_fit_together() -> None:
    refiner = Refiner(shipped())
    with pytest.raises(ValueError, match="not positive definite"):
        refiner.refined(np.array([0.0, 0.0, 1.0]), np.zeros(5), np.zeros((5, 5)))
    with pytest.raises(ValueError, match="change: 32 bytes, 40 expected"):
        refiner.refined(np.array([0.0, 0.0, 1.0]), np.zeros(4), np.eye(5))
    wild = Refiner(replace(shipped(), exponent=np.full((3, 1), 12, dtype=np.intp)))
    with pytest.raises(ValueError, match="than there is room for"):
        wild.refined(np.array([0.0, 0.0, 1.0]), np.zeros(5), np.eye(5))


def test_response_that_is_damaged_is_refused() -> None:
    packed = metadata_of_default()[RESPONSE_KEY]
    assert parse_response({}) is None
    for broken, complaint in (
        (packed[:-9], "its response is wrong"),
        (packed.replace('"exponent":[[1],', '"exponent":[[1],[1],'), "another size"),
        (packed.replace('"shape":[17,', '"shape":[16,'), "another size"),
        (packed.replace('"scale_n":', '"scale_n":-'), "its response is wrong"),
    ):
        assert broken != packed
        with pytest.raises(ValueError, match=complaint):
            parse_response({RESPONSE_KEY: broken})


# --- its purpose ---


def test_two_steps_from_a_rough_answer_reach_maximum_likelihood(pad: Pad) -> None:
    """Frames at 2 mG within 11 mm, answers a deviation off: on average they end within 2 % of the best."""
    random = np.random.default_rng(6)
    angle, radius = random.uniform(0, 2 * np.pi, 400), 11.0 * np.sqrt(random.uniform(0, 1, 400))
    press = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), random.uniform(0.28, 1.98, 400)])
    solver = FrameSolver(pad, rest_field_of(pad), "drifting", NOISE_T)
    tracked = solver.solved(pressed_fields(pad, press) + random.normal(0, NOISE_T, (400, 4, 3)))
    response, change = shipped(), tracked.pose[:, :5] - solver.rest_pose[:5]
    best = invert(response, change, tracked.covariance, across=3)
    _, spread, _ = most_likely(response, change, tracked.covariance, press, 0)
    rough = press + np.sqrt(np.einsum("kii->ki", spread)) * random.normal(size=press.shape)
    refiner = Refiner(response)
    found = np.array([refiner.refined(*one)[0] for one in zip(rough, change, tracked.covariance, strict=True)])
    share = np.abs(found - press).mean(axis=0) / np.abs(best - press).mean(axis=0)
    assert (share < 1.02).all()
    assert (np.abs(rough - press).mean(axis=0) / np.abs(best - press).mean(axis=0) > 0.8).all()


def test_firmer_press_near_the_rim_is_within_the_deviations(pad: Pad) -> None:
    """A light press in the middle explains an uncertain pose as well: 10 of these were off by over five deviations."""
    random, model = np.random.default_rng(1), ContactModel.load("default", pad, refine=True)
    spread = np.array([0.04, 0.04, 0.02, 0.008, 0.008])
    press = np.column_stack([random.uniform(-10.0, 10.0, (3000, 2)), random.uniform(0.1, 1.0, 3000)])
    changes = shipped().change(press) + random.normal(size=(3000, 5)) * spread
    errors, deviations = [], []
    for true, change in zip(press, changes, strict=True):
        upright = float(np.sqrt(1.0 - change[3] ** 2 - change[4] ** 2))
        by_change = np.vstack([np.eye(5), [0.0, 0.0, 0.0, -change[3] / upright, -change[4] / upright]])
        covariance = by_change @ np.diag((spread * [1e-3, 1e-3, 1e-3, 1.0, 1.0]) ** 2) @ by_change.T
        position_m = 1e-3 * (model.rest_pose[:3] + change[:3])
        found = model.estimate(position_m, np.array([change[3], change[4], upright]), covariance)
        if found.force_n > 2.0 * found.force_sd_n:
            errors.append([1e3 * found.x_m - true[0], 1e3 * found.y_m - true[1], found.force_n - true[2]])
            deviations.append([1e3 * found.x_sd_m, 1e3 * found.y_sd_m, found.force_sd_n])
    worst = np.abs(np.array(errors) / np.array(deviations)).max(axis=1)
    assert len(worst) > 200
    assert worst.max() < 5.0
    assert np.median(worst) > 0.5
