"""Computes the tail of the χ² distribution in closed form: scipy.stats would cost the daemon 100 MB of memory."""

from __future__ import annotations

import math
from functools import lru_cache

from fmfts.arithmetic.elementary import exp, log
from fmfts.arithmetic.series import erfc

TOLERANCE = 1e-13  # relative, of a quantile


def survival(value: float, degrees_of_freedom: int) -> float:
    """Probability that χ² exceeds `value`."""
    return _survival_and_density(value, degrees_of_freedom)[0]


def _survival_and_density(value: float, degrees_of_freedom: int) -> tuple[float, float]:
    """Survival function (Abramowitz & Stegun 26.4.4, 26.4.5) and probability density, for whole degrees of freedom."""
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
    """The value that χ² exceeds with `probability`: Newton's method, with bisection where a step leaves the bracket.

    Raises ValueError for fewer than one degree of freedom, or a probability outside (0, 1].
    """
    if degrees_of_freedom < 1 or not 0.0 < probability <= 1.0:
        raise ValueError(f"no χ² quantile for {degrees_of_freedom} degrees of freedom and probability {probability}")
    low, high = 0.0, float(degrees_of_freedom)
    while survival(high, degrees_of_freedom) > probability:
        low, high = high, 2.0 * high
    value = 0.5 * (low + high)
    for _ in range(100):
        beyond, density = _survival_and_density(value, degrees_of_freedom)
        low, high = (value, high) if beyond > probability else (low, value)
        # Newton's step on the logarithm of the tail, which is nearly straight; the tail itself is not, for example near
        # 1e-9. Tail and density may both underflow to zero.
        has_step = beyond > 0.0 and density > 0.0
        step_to = value + (beyond / density) * log(beyond / probability) if has_step else low
        if abs(step_to - value) <= TOLERANCE * value or high - low <= TOLERANCE * value:
            return step_to if has_step else value
        value = step_to if low < step_to < high else 0.5 * (low + high)
    return value
