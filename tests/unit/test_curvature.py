"""Bias and bound of a most likely answer where the model bends over the noise, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts_lab.bench.curvature import curvature, weight_with_free_ambient

TRUE, NOISE = np.array([[1.0], [2.0], [3.0]]), 0.3


def test_square_pad_has_bias_and_bound_of_the_closed_form() -> None:
    """y = u² with noise s: the root of y is too small by s²/8u³ in the mean, to second order."""
    found = curvature(lambda at: at**2, TRUE, [1e-3], np.eye(1) / NOISE**2)
    true = TRUE[:, 0]
    assert found.bias[:, 0] == pytest.approx(-(NOISE**2) / (8 * true**3), rel=1e-6)
    first, mixed = 4 * true**2 / NOISE**2, 4 * true / NOISE**2
    second = 4 / NOISE**2 + 2 * first**2
    assert found.bound[:, 0, 0] == pytest.approx(1 / (first - mixed**2 / second), rel=1e-6)


def test_bias_is_what_many_readings_show() -> None:
    random = np.random.default_rng(3)
    found = curvature(lambda at: at**2, TRUE[1:], [1e-3], np.eye(1) / NOISE**2)
    readings = TRUE[1:] ** 2 + random.normal(0.0, NOISE, (2, 400_000))
    errors = np.sqrt(readings) - TRUE[1:]
    deviation = errors.std(axis=1) / np.sqrt(errors.shape[1])
    assert np.abs(errors.mean(axis=1)).min() > 3 * deviation.max()  # there is a field to be seen
    # The next order is (noise / value)² of this one: 5 % at 2.
    assert errors.mean(axis=1) == pytest.approx(found.bias[:, 0], abs=4 * deviation.max() + 3e-5)


def test_straight_model_has_no_bias_and_the_linear_bound() -> None:
    slope = np.random.default_rng(1).normal(size=(12, 3))
    weight = weight_with_free_ambient(NOISE, 4)
    found = curvature(lambda at: at @ slope.T, np.ones((2, 3)), [1e-2] * 3, weight)
    assert found.bias == pytest.approx(np.zeros((2, 3)), abs=1e-9)
    # The ambient field as three more unknowns gives the same: removing it first loses nothing.
    whole = np.hstack([slope, np.tile(np.eye(3), (4, 1))]) / NOISE
    assert found.bound[0] == pytest.approx(np.linalg.inv(whole.T @ whole)[:3, :3], rel=1e-6)


def test_curvature_of_two_unknowns_is_that_of_the_model() -> None:
    found = curvature(
        lambda at: np.column_stack([at[:, 0] ** 2 * at[:, 1], at[:, 1] ** 2]), np.array([[2.0, 3.0]]), [1e-3, 2e-3],
        np.eye(2),
    )  # fmt: skip
    assert found.slope[0] == pytest.approx(np.array([[12.0, 4.0], [0.0, 6.0]]), abs=1e-6)
    assert found.bend[0] == pytest.approx(np.array([[[6.0, 4.0], [4.0, 0.0]], [[0.0, 0.0], [0.0, 2.0]]]), abs=1e-6)
