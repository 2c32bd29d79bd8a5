"""Cubic B-splines against SciPy's, and powers against differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from fmfts.arithmetic.spline import cover, powers, spline_collocation

FIRST, SPACING, CELLS = -3.0, 0.5, 7
PLACES = np.linspace(FIRST, FIRST + SPACING * CELLS, 211)


def whole(places: np.ndarray, slope: bool = False) -> np.ndarray:
    """(K, cells + 3)."""
    splines = cover(places, FIRST, SPACING, CELLS)
    out = np.zeros((len(places), CELLS + 3))
    np.put_along_axis(out, splines.indices, splines.slope if slope else splines.value, axis=1)
    return out


@pytest.mark.parametrize("slope", [False, True])
def test_splines_are_those_of_scipy(slope: bool) -> None:
    knots = FIRST + SPACING * np.arange(-3, CELLS + 4)
    theirs = BSpline(knots, np.eye(CELLS + 3), 3)
    expected = theirs.derivative()(PLACES) if slope else theirs(PLACES)
    np.testing.assert_allclose(whole(PLACES, slope), expected, rtol=0.0, atol=1e-14)


def test_place_beyond_the_knots_counts_as_on_the_last() -> None:
    beyond = np.array([FIRST - 5.0, FIRST + SPACING * CELLS + 5.0, np.nan])
    ends = np.array([FIRST, FIRST + SPACING * CELLS, FIRST])
    np.testing.assert_array_equal(whole(beyond), whole(ends))


def test_collocation_finds_the_coefficients_of_a_cubic() -> None:
    knots = FIRST + SPACING * np.arange(CELLS + 1)
    coefficient = np.linalg.solve(spline_collocation(CELLS + 1), np.concatenate([[0.0], knots**3 - knots, [0.0]]))
    np.testing.assert_allclose(whole(PLACES) @ coefficient, PLACES**3 - PLACES, rtol=0.0, atol=1e-12)


def test_powers_follow_their_tangents_above_the_most() -> None:
    x = np.array([0.0, 0.7, 1.5, 2.0, 4.0])
    exponent = np.arange(1, 5)
    inside = np.minimum(x, 1.5)[:, None]
    expected = inside**exponent + (x[:, None] - inside) * exponent * inside ** (exponent - 1)
    np.testing.assert_allclose(powers(x, 1.5, 4), expected, rtol=1e-15)
    np.testing.assert_allclose(powers(x, np.inf, 4), x[:, None] ** exponent, rtol=1e-15)


@pytest.mark.parametrize(("spacing", "cells"), [(0.0, 7), (np.nan, 7), (-1.0, 7), (0.5, 0), (0.5, 10001)])
def test_impossible_knots_are_refused(spacing: float, cells: int) -> None:
    with pytest.raises(ValueError, match="cells: 1 to 10000"):
        cover(PLACES, FIRST, spacing, cells)
    with pytest.raises(ValueError, match="65 powers, at most 64"):
        powers(PLACES, 1.0, 65)
