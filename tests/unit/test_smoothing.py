"""The pose filter: no lag behind an even motion, less noise, and nothing in the way of a press."""

from __future__ import annotations

import numpy as np
import pytest
from contact_steps_in_c import SmootherInC
from numpy.typing import NDArray
from scipy.special import chdtri as chi2_of_tail

Array = NDArray[np.float64]
PERIOD_S = 1.0 / 220.0
MEMORY_S = 0.04
DEVIATION = np.array([15e-6, 15e-6, 4e-6, 2.5e-3, 2.5e-3])
COVARIANCE = np.diag([*DEVIATION**2, 0.0])
REST = np.array([0.0, 0.0, 12e-3])
UP = np.array([0.0, 0.0, 1.0])


def smoothed(smoother: SmootherInC, positions: Array) -> Array:
    return np.array([smoother.update(position, UP, COVARIANCE, PERIOD_S)[0] for position in positions])


def test_even_and_curved_motion_are_followed_without_lag() -> None:
    """Poses that move by 2 deviations in a frame, or rise as a finger leaves the centre, for 1 s; the start is what a
    memory of 40 ms forgets."""
    frame = np.arange(220)[:, None]
    for track in (frame * [30e-6, 0.0, 0.0], (frame - 110) ** 2 * [0.0, 0.0, 0.02e-6]):
        lag = track - (smoothed(SmootherInC(MEMORY_S), REST + track) - REST)
        assert np.abs(lag[160:]).max() < 1e-8


def test_noise_is_reduced_as_the_fading_memory_says() -> None:
    """Variance of the output over that of the input, for white noise, with θ = e^(−T/τ) (Morrison, chapter 13):
    ((1−θ)/(1+θ)⁵)·(19 + 24θ + 16θ² + 6θ³ + θ⁴). 5,000 frames with 20 of memory give the deviation to 6 %; jumps that
    the gate believes are one in a thousand."""
    noise = np.random.default_rng(1).normal(size=(5000, 3)) * DEVIATION[:3]
    found = smoothed(SmootherInC(MEMORY_S), REST + noise) - REST
    fading = np.exp(-PERIOD_S / MEMORY_S)
    expected = np.sqrt((1 - fading) / (1 + fading) ** 5 * np.polyval([1, 6, 16, 24, 19], fading))
    np.testing.assert_allclose(found.std(axis=0) / DEVIATION[:3], expected, rtol=0.12)
    assert expected < 0.6


def test_smoothing_follows_press_and_release_at_once() -> None:
    smoother = SmootherInC(MEMORY_S)
    smoothed(smoother, np.tile(REST, (20, 1)))
    pressed = REST - [0.0, 0.0, 0.1e-3]
    np.testing.assert_array_equal(smoothed(smoother, pressed[None])[0], pressed)
    smoothed(smoother, np.tile(pressed, (20, 1)))
    np.testing.assert_array_equal(smoothed(smoother, REST[None])[0], REST)


@pytest.mark.parametrize(("share", "jumps"), [(0.99, False), (1.01, True)])
def test_filter_begins_anew_where_noise_does_not_explain_a_pose(share: float, jumps: bool) -> None:
    """An innovation has less than twice the variance of a pose; noise alone exceeds this one time in a thousand."""
    smoother = SmootherInC(MEMORY_S)
    smoothed(smoother, np.tile(REST, (20, 1)))
    moved = REST - [0.0, 0.0, DEVIATION[2] * np.sqrt(2.0 * share * chi2_of_tail(5, 1e-3))]
    assert (smoothed(smoother, moved[None])[0] == pytest.approx(moved, rel=1e-12)) == jumps


def test_filter_without_memory_changes_nothing() -> None:
    positions = REST + np.random.default_rng(2).normal(size=(10, 3)) * 1e-5
    np.testing.assert_allclose(smoothed(SmootherInC(0.0), positions), positions, rtol=1e-15)


@pytest.mark.parametrize("elapsed_s", [0.0, PERIOD_S, 5.0])
def test_axis_stays_a_unit_vector_and_a_gap_is_bridged(elapsed_s: float) -> None:
    smoother = SmootherInC(MEMORY_S)
    random = np.random.default_rng(3)
    for _ in range(30):
        tilt = random.normal(size=2) * 2e-3
        axis = np.append(tilt, np.sqrt(1.0 - tilt @ tilt))
        _, found, covariance = smoother.update(REST, axis, COVARIANCE, elapsed_s)
        assert np.linalg.norm(found) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(covariance, COVARIANCE, rtol=1e-15)
