"""The χ² distribution's tail for whole degrees of freedom, in closed form: scipy.stats would cost the daemon 100 MB."""

from __future__ import annotations

import math
from functools import lru_cache

from fmfts.arithmetic.elementary import exp, log
from fmfts.arithmetic.series import erfc

SETTLED = 1e-13


def survival(value: float, degrees_of_freedom: int) -> float:
    """Probability that χ² exceeds `value`."""
    return _survival_and_density(value, degrees_of_freedom)[0]


def _survival_and_density(value: float, degrees_of_freedom: int) -> tuple[float, float]:
    """Abramowitz & Stegun 26.4.4 and 26.4.5, and the derivative of both with the other sign."""
    half = value / 2.0
    if degrees_of_freedom % 2:
        total, term, first = erfc(math.sqrt(half)), 2.0 * exp(-half) * math.sqrt(half / math.pi), 3
    else:
        total, term, first = exp(-half), exp(-half) * half, 4
    for k in range(first, degrees_of_freedom + 1, 2):
        total += term
        term *= value / k
    return total, term * degrees_of_freedom / (2.0 * value) if value else math.inf


@lru_cache(maxsize=256)
def quantile(probability: float, degrees_of_freedom: int) -> float:
    """The value that χ² exceeds with `probability`: Newton's method, within a bracket that is halved where it fails.

    ValueError for fewer than one degree of freedom, or a probability that is none.
    """
    if degrees_of_freedom < 1 or not 0.0 < probability <= 1.0:
        raise ValueError(f"the χ² of {degrees_of_freedom} degrees of freedom that is exceeded with {probability}")
    low, high = 0.0, float(degrees_of_freedom)
    while survival(high, degrees_of_freedom) > probability:
        low, high = high, 2.0 * high
    value = 0.5 * (low + high)
    for _ in range(100):
        beyond, density = _survival_and_density(value, degrees_of_freedom)
        low, high = (value, high) if beyond > probability else (low, value)
        # On the logarithm, which is nearly straight: of 1e-9 the plain tail is not. Both may be below the least double.
        known = beyond > 0.0 and density > 0.0
        nearer = value + (beyond / density) * log(beyond / probability) if known else low
        if abs(nearer - value) <= SETTLED * value or high - low <= SETTLED * value:
            return nearer if known else value
        value = nearer if low < nearer < high else 0.5 * (low + high)
    return value
