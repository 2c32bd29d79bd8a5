"""The χ² distribution's tail for whole degrees of freedom, in closed form: scipy.stats would cost the daemon 100 MB."""

from __future__ import annotations

import math
from functools import lru_cache


def survival(value: float, degrees_of_freedom: int) -> float:
    """Probability that χ² exceeds `value` (Abramowitz & Stegun 26.4.4 and 26.4.5)."""
    half = value / 2.0
    if degrees_of_freedom % 2:
        total, term, first = math.erfc(math.sqrt(half)), math.exp(-half) * math.sqrt(half / math.pi) * 2.0, 3
    else:
        total, term, first = math.exp(-half), math.exp(-half) * half, 4
    for k in range(first, degrees_of_freedom + 1, 2):
        total += term
        term *= value / k
    return total


@lru_cache(maxsize=256)
def quantile(probability: float, degrees_of_freedom: int) -> float:
    """The value that χ² exceeds with `probability`."""
    low, high = 0.0, 1.0
    while survival(high, degrees_of_freedom) > probability:
        high *= 2.0
    while high - low > 1e-9 * high:
        middle = (low + high) / 2.0
        if survival(middle, degrees_of_freedom) > probability:
            low = middle
        else:
            high = middle
    return high
