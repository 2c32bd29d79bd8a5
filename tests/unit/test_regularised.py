"""Networks that know how smooth they may be: what few rows, noise and faint components do to them."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.pad import Array
from fmfts_calibrate.levenberg import Layers
from fmfts_lab.calibration.regressors import BackPropagation
from fmfts_lab.calibration.regularised import BayesianNetwork, Components, RegularisedBasis, bayesian_steps

NOISE = 0.1


def wave(inputs: Array) -> Array:
    return np.column_stack([np.sin(3.0 * inputs[:, 0]), np.cos(2.0 * inputs[:, 0])])


@pytest.fixture
def rows() -> tuple[Array, Array]:
    """40 rows of a wave with noise."""
    random = np.random.default_rng(1)
    inputs = random.uniform(-1.0, 1.0, (40, 1))
    return inputs, wave(inputs) + NOISE * random.standard_normal((40, 2))


def test_regularised_network_separates_noise_from_the_function(rows: tuple[Array, Array]) -> None:
    """20 neurons, 82 parameters, 80 values: least squares passes through them, the evidence finds some ten parameters
    and the noise that was drawn (a fit knows the deviation of so many values to 8 %)."""
    inputs, target = rows
    between = np.linspace(-0.9, 0.9, 100)[:, None]
    network, rough = BayesianNetwork((20,), 100).fit(inputs, target), BackPropagation((20,), 200).fit(inputs, target)
    error, rough_error = (np.sqrt(np.mean((one.predict(between) - wave(between)) ** 2)) for one in (network, rough))
    assert error < 0.6 * NOISE
    assert rough_error > 2.0 * error
    start = Layers.drawn((1, 20, 2), np.random.default_rng(0))
    *_, last = bayesian_steps(start, inputs, target)
    assert 5.0 < last.effective < 20.0
    drawn = np.sqrt(np.mean((target - wave(inputs)) ** 2))
    assert np.sqrt(last.squared_error / (1.0 - last.effective / 80.0)) == pytest.approx(drawn, rel=0.15)


def test_best_start_is_deterministic(rows: tuple[Array, Array]) -> None:
    first, second = (BayesianNetwork((4, 4), 20, starts=3).fit(*rows).layers.vector() for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_components_show_faint_signals_and_drop_repetitions() -> None:
    random = np.random.default_rng(2)
    strong, faint = random.standard_normal((2, 200))
    values = np.column_stack([strong, 3.0 * strong + 1e-3 * faint, strong, np.full(200, 7.0)])
    shrunk = Components.of(values).shrunk(values)
    assert shrunk.shape == (200, 2)
    np.testing.assert_allclose(np.cov(shrunk.T, bias=True), np.eye(2), atol=1e-9)
    assert abs(np.corrcoef(shrunk[:, 1], faint)[0, 1]) > 0.95


def test_gaussians_interpolate_rows_only_without_a_ridge(rows: tuple[Array, Array]) -> None:
    inputs, target = rows
    exact, smooth = (RegularisedBasis(0.02, 1e-12), RegularisedBasis(0.5, 1e-2))
    np.testing.assert_allclose(exact.fit(inputs, target).predict(inputs), target, atol=1e-6)
    between = np.linspace(-0.8, 0.8, 100)[:, None]
    error = smooth.fit(inputs, target).predict(between) - wave(between)
    assert np.sqrt(np.mean(error**2)) < NOISE


def test_unsupported_weights_are_refused(rows: tuple[Array, Array]) -> None:
    for regressor in (BayesianNetwork((2,)), RegularisedBasis(1.0, 1e-6)):
        with pytest.raises(ValueError, match="no weights"):
            regressor.fit(*rows, np.ones(40))
