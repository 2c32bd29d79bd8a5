"""The change of field since rest, in C, against its equation in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.several import _several
from fmfts.several.since_rest import present


@pytest.mark.parametrize("with_others", [False, True])
def test_change_and_variance_follow_their_equation(with_others: bool) -> None:
    random = np.random.default_rng(5)
    field, bend, gain, offset, noise, rest = random.uniform(0.5, 2.0, (6, 8, 3))
    share = random.uniform(0.5, 2.0, (8, 1))
    recent, now, foreign = random.uniform(0.0, 1.0, (3, 24))
    there = random.uniform(size=(8, 3)) < 0.8
    field[~there], bend[2, 1] = np.nan, np.nan
    change, variance = np.empty(24), np.empty(24)
    others = (foreign, now) if with_others else (None, None)
    _several.since_rest(
        field, bend, gain, offset, noise, rest, recent, change, variance, share, there, *others, 0.98, 0.1
    )
    own = np.where(there, field, 0.0) / gain - offset - (foreign.reshape(8, 3) if with_others else 0.0)
    left = 0.1 * np.maximum(recent - (now if with_others else 0.0), 0.0)
    expected = np.square(noise * share / gain) + np.square(np.nan_to_num(bend))
    np.testing.assert_allclose(change, (own / 0.98 - rest).ravel(), rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(variance, expected.ravel() + np.square(left), rtol=1e-14)


def test_value_is_there_if_finite_and_not_stuck() -> None:
    field, repeats, allowed = np.ones((2, 3)), np.zeros((2, 3), dtype=np.int64), np.array([[5, 5, 5]] * 2)
    assert present(field, repeats, allowed)[1]
    field[0, 1], repeats[1, 2], repeats[1, 0] = np.nan, 6, 5
    there, is_whole = present(field, repeats, allowed)
    assert there.tolist() == [[True, False, True], [True, True, False]]
    assert not is_whole
    with pytest.raises(ValueError, match="array 0 has 48 bytes"):
        _several.list_present(
            field, np.ones((3, 3)), np.zeros((3, 3), dtype=np.int64), np.empty((3, 3), dtype=np.bool_)
        )
