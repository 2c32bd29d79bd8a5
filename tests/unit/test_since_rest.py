"""The change of field since rest, in C, against its equation in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from fmfts.pad import Array
from fmfts.several import _several


@pytest.mark.parametrize("with_others", [False, True])
def test_change_and_variance_follow_their_equation(with_others: bool) -> None:
    random = np.random.default_rng(5)
    field, bend, gain, offset, noise, rest = random.uniform(0.5, 2.0, (6, 8, 3))
    share = random.uniform(0.5, 2.0, (8, 1))
    recent, now, foreign = random.uniform(0.0, 1.0, (3, 24))
    now *= random.choice([-1.0, 1.0], 24)
    there, wanted = np.empty(24, dtype=np.bool_), random.uniform(size=(8, 3)) < 0.8
    field[~wanted], bend[2, 1] = np.nan, np.nan
    change, variance, left = np.empty(24), np.empty(24), recent.copy()
    others = (foreign, now) if with_others else (None, None)
    at_rest = np.array([gain, offset, noise, rest, np.full((8, 3), np.inf)])
    samples, factors = (field, bend, share, np.zeros((8, 3), dtype=np.int64)), np.array([0.98, 0.1, 1.25])
    _several.since_rest(at_rest, factors, *samples, left, change, variance, there, *others)
    own = np.where(wanted, field, 0.0) / gain - offset - (foreign.reshape(8, 3) if with_others else 0.0)
    presses = np.abs(now) if with_others else np.zeros(24)
    most = np.maximum(recent, presses) / 1.25
    crept = 0.1 * np.maximum(most - presses, 0.0)
    expected = np.square(noise * share / gain) + np.square(np.nan_to_num(bend))
    np.testing.assert_allclose(change, (own / 0.98 - rest).ravel(), rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(variance, expected.ravel() + np.square(crept), rtol=1e-14)
    np.testing.assert_allclose(left, most, rtol=1e-15)
    np.testing.assert_array_equal(there, wanted.ravel())


def rested(field: Array, repeats: NDArray[np.int64], bend: Array) -> tuple[NDArray[np.bool_], bool]:
    """Which values there are, and whether the field jumped. An axis may repeat a value five times."""
    one, there, room = np.ones((2, 3)), np.empty(6, dtype=np.bool_), np.empty((3, 6))
    at_rest, samples = np.array([one, one, one, one, 5.0 * one]), (field, bend, np.ones((2, 1)), repeats)
    jumped = _several.since_rest(at_rest, np.array([1.0, 0.1, 1.0]), *samples, *room, there, None, None)
    return there.reshape(2, 3), jumped


def test_value_is_there_if_finite_and_not_stuck() -> None:
    field, repeats, straight = np.ones((2, 3)), np.zeros((2, 3), dtype=np.int64), np.zeros((2, 3))
    assert rested(field, repeats, straight)[0].all()
    field[0, 1], repeats[1, 2], repeats[1, 0] = np.nan, 6, 5
    assert rested(field, repeats, straight)[0].tolist() == [[True, False, True], [True, True, False]]
    with pytest.raises(ValueError, match="array 3 has 72 bytes, 6 doubles"):
        rested(field, repeats, np.zeros((3, 3)))


def test_field_jumps_between_samples_that_are_far_off_their_line() -> None:
    field, repeats = np.ones((2, 3)), np.zeros((2, 3), dtype=np.int64)
    for bend_t, jumps in ((2.4e-5, False), (2.6e-5, True), (np.nan, False)):
        bend = np.zeros((2, 3))
        bend[1, 1] = bend_t
        assert rested(field, repeats, bend)[1] is jumps
