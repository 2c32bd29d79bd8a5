"""What a door says of a number that cannot be."""

from __future__ import annotations

import math

import pytest

from fmfts.common.possible import SAMPLES, TEMPERATURE_C


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (0, "0 is no number of samples: from 1 to 1e+07"),
        (math.nan, "nan is no"),
        (math.inf, "inf is no"),
        (10**400, "an integer of more than 300 digits is no"),
        (-(10**400), "an integer of more than 300 digits is no"),
    ],
)
def test_impossible_number_is_named_with_the_valid_range(value: float, told: str) -> None:
    with pytest.raises(ValueError, match=told.replace("+", r"\+")):
        SAMPLES.require([5, value])


def test_ends_of_a_range_are_in_it() -> None:
    TEMPERATURE_C.require([-60.0, 150.0])
