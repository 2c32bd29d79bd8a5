"""How even the ambient field was while the robot turned: the parts of noise, attitude and place."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.baseline import BaselineError
from fmfts.baseline.evenness import STRENGTH_DEVIATION, unevenness
from fmfts.baseline.window_means import MEAN_OF, turning_window

ORIENTATIONS, SENSORS, EARTH_T = 400, 4, 5e-5
BY_FIELD = np.broadcast_to(np.eye(3), (SENSORS, 3, 3))


def _told(random: np.random.Generator, stronger: np.ndarray, attitude: np.ndarray, noise_t: float) -> float:
    """The reports of ideal chips in a field that is stronger by this share (K,) at unit vectors (K, 3)."""
    field = EARTH_T * (1.0 + stronger)[:, None] * attitude
    reported = field[:, None] + random.normal(0.0, noise_t, (ORIENTATIONS, SENSORS, 3))
    return unevenness(reported, BY_FIELD, np.full((SENSORS, 3), noise_t))


def test_stuck_chip_does_not_hide_the_speed_of_a_turn() -> None:
    angle = np.arange(600) / 220.0  # 1 rad/s: an arc of 0.05 rad in eleven frames
    slow = np.stack([np.cos(angle), np.sin(angle), np.zeros(600)], axis=1)[:, None].repeat(SENSORS, axis=1)
    slow[:, 2] = 0.3
    assert turning_window(slow) == MEAN_OF
    assert turning_window(slow[::40]) < 3


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(4)


@pytest.fixture
def attitude(random: np.random.Generator) -> np.ndarray:
    turned = random.normal(size=(ORIENTATIONS, 3))
    unit: np.ndarray = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return unit


@pytest.mark.parametrize("noise_t", [1e-8, 2.5e-6])
def test_even_field_is_even_whatever_the_noise(
    random: np.random.Generator, attitude: np.ndarray, noise_t: float
) -> None:
    """2.5 µT is 2.5 % of the strength that four chips tell; the mean of 400 squares of it is known to a 14th part."""
    told = _told(random, np.zeros(ORIENTATIONS), attitude, noise_t)
    assert STRENGTH_DEVIATION <= told <= max(STRENGTH_DEVIATION, 0.5 * noise_t / EARTH_T)


@pytest.mark.parametrize("noise_t", [1e-8, 1e-6])
def test_uneven_field_is_counted(random: np.random.Generator, attitude: np.ndarray, noise_t: float) -> None:
    told = _told(random, random.normal(0.0, 0.04, ORIENTATIONS), attitude, noise_t)
    assert told == pytest.approx(0.04, rel=0.15)  # four times the uncertainty of a deviation from 400 squares


@pytest.mark.parametrize("noise_t", [1e-8, 2.5e-6])
def test_steel_that_turns_along_is_refused(random: np.random.Generator, attitude: np.ndarray, noise_t: float) -> None:
    """8 % stronger along x, and weaker along y: x² − y² of unit vectors has a deviation of 0.52."""
    with pytest.raises(BaselineError, match=r"stronger and weaker by [34]\.\d % .* attitude.*Steel turns with the pad"):
        _told(random, 0.08 * (attitude[:, 0] ** 2 - attitude[:, 1] ** 2), attitude, noise_t)


def test_place_beside_steel_furniture_is_refused(random: np.random.Generator, attitude: np.ndarray) -> None:
    with pytest.raises(BaselineError, match=r"by 1\d % \(mean\) from place to place.*in one place"):
        _told(random, random.normal(0.0, 0.15, ORIENTATIONS), attitude, 1e-7)
