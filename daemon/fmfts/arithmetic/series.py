"""Computes sin, cos, erf and erfc by their series in decimals; slow, so only used before the first frame.

Python's decimals round the same everywhere. With thirty digits the errors of a sum are far below a double's last bit:
the result is the correctly rounded value, except for one argument in a billion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import ROUND_HALF_EVEN, Context, Decimal, localcontext

DIGITS = 30
# Above FAR, erfc is a continued fraction of TERMS terms: at FAR, 1 − erf has lost three of the thirty digits.
FAR, TERMS = 2.0, 120
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620900")
# Above it, erfc is less than the smallest double, and erf is one.
ERFC_UNDERFLOW = 27.3


def sin(radians: float) -> float:
    return _rounded(radians, lambda x: _alternating(x, x, 2))


def cos(radians: float) -> float:
    return _rounded(radians, lambda x: _alternating(x, Decimal(1), 1))


def erf(x: float) -> float:
    """2/√π ∫₀ˣ exp(−t²) dt."""
    return math.copysign(1.0, x) if abs(x) > ERFC_UNDERFLOW else _rounded(x, _erf)


def erfc(x: float) -> float:
    """1 − erf(x), correct to its last bit also where it is small."""
    if abs(x) > ERFC_UNDERFLOW:
        return 0.0 if x > 0.0 else 2.0
    return _rounded(x, _far_erfc if x > FAR else lambda value: 1 - _erf(value))


def _rounded(x: float, function: Callable[[Decimal], Decimal]) -> float:
    if not math.isfinite(x):
        raise ValueError(f"a finite number is needed, not {x}")
    with localcontext(Context(prec=DIGITS, rounding=ROUND_HALF_EVEN, traps=[])):
        return float(function(Decimal(x)))


def _alternating(x: Decimal, first: Decimal, count: int) -> Decimal:
    """first·(1 − x²/(n(n+1)) + …), n from `count`. First reduces the angle to between −π and π."""
    if abs(x) > PI:
        turn = 2 * PI
        reduced = x - (x / turn).to_integral_value() * turn
        return _alternating(reduced, reduced if count == 2 else first, count)
    total = term = first
    square = x * x
    while total + term != total:
        term *= -square / (count * (count + 1))
        total += term
        count += 2
    return total


def _erf(x: Decimal) -> Decimal:
    """2/√π exp(−x²) Σ 2ⁿ x²ⁿ⁺¹/(1·3·…·(2n+1)): Abramowitz & Stegun 7.1.6. All terms have the same sign."""
    total = term = x
    odd, twice_square = 1, 2 * x * x
    while total + term != total:
        odd += 2
        term *= twice_square / odd
        total += term
    return 2 / PI.sqrt() * (-x * x).exp() * total


def _far_erfc(x: Decimal) -> Decimal:
    """exp(−x²)/√π · 1/(x + ½/(x + 1/(x + ³⁄₂/(x + …)))): Abramowitz & Stegun 7.1.14."""
    rest = x
    for term in range(TERMS, 0, -1):
        rest = x + term / (2 * rest)
    return (-x * x).exp() / PI.sqrt() / rest
