"""Computes exp and log in Python, with the same bits as elementary.h.

exp: P. T. P. Tang, "Table-driven implementation of the exponential function in IEEE floating-point arithmetic", ACM
TOMS 15 (1989) 144. Within 0.54 units in the last place.
log: x = 2^m z with z about one, and log z = 2 artanh s with s = (z − 1)/(z + 1) as a sum of two doubles. Within 0.54.
"""

from __future__ import annotations

import math

from fmfts.arithmetic.tables import EXP_STEPS, LN2_HIGH, LN2_LOW, POWERS_OF_TWO

# Adding ROUND and subtracting it again rounds to a whole number.
ROUND = 1.5 * (1 << 52)
SPLIT = (1 << 27) + 1.0  # T. J. Dekker, "A floating-point technique for extending the available precision", 1971
SQRT_HALF = math.sqrt(0.5)
LARGEST_EXP, SMALLEST_EXP = float.fromhex("0x1.62e42fefa39efp9"), -745.2


def exp(x: float) -> float:
    """e to the power of x."""
    if math.isnan(x):
        return x
    if x > LARGEST_EXP:
        return math.inf
    if x < SMALLEST_EXP:
        return 0.0
    count = (x * (EXP_STEPS / (LN2_HIGH + LN2_LOW)) + ROUND) - ROUND
    whole = int(count)
    high = x - count * (LN2_HIGH / EXP_STEPS)
    low = -count * (LN2_LOW / EXP_STEPS)
    r = high + low
    tail = r * r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0)))))
    power_high, power_low = POWERS_OF_TWO[whole % EXP_STEPS]
    value = power_high + (power_low + (power_high + power_low) * (high + (low + tail)))
    # Scale in two steps: 2^exponent alone may be beyond a double's range.
    exponent = whole // EXP_STEPS
    return math.ldexp(math.ldexp(value, exponent // 2), exponent - exponent // 2)


def log(x: float) -> float:
    """Natural logarithm."""
    if not 0.0 < x < math.inf:
        return x if math.isnan(x) or x == math.inf else -math.inf if x == 0.0 else math.nan
    z, m = math.frexp(x)
    if z < SQRT_HALF:
        z, m = 2.0 * z, m - 1
    f = z - 1.0
    u = 2.0 + f
    s = f / u
    # s_low is the rounding error of s: (f − s·(2 + f)) / u, exact but for its last rounding.
    product, error = _two_product(s, u)
    s_low = ((f - product) - error - s * (f - (u - 2.0))) / u
    w = s * s
    series = 1.0 / 21.0 + w * (1.0 / 23.0)
    for odd in (19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0):
        series = 1.0 / odd + w * series
    tail = 2.0 * (s_low + s * w * series)
    # |m ln 2| is larger than |2 s|, or zero.
    large, small = m * LN2_HIGH, 2.0 * s
    total = large + small
    rest = small - (total - large) if m else 0.0
    return total + (rest + (m * LN2_LOW + tail))


def _two_product(a: float, b: float) -> tuple[float, float]:
    """The rounded product a·b, and its rounding error."""
    a_high, b_high = SPLIT * a - (SPLIT * a - a), SPLIT * b - (SPLIT * b - b)
    a_low, b_low = a - a_high, b - b_high
    product = a * b
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
