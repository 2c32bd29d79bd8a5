"""exp and log, the same to the last bit on every processor.

The functions of a C library are not: glibc has variants of exp, log and pow with fused multiply-add, and NumPy has
others with wide vectors, so that two processors round differently. These use nothing but +, −, × and ÷, which IEEE 754
rounds the same everywhere: elementary.h, or elementary_reference.py where that was not compiled.
"""

from __future__ import annotations

from typing import Any

from fmfts.arithmetic.compiled import AVAILABLE, _arithmetic

__all__ = ["exp", "log", "power", "square"]

if AVAILABLE:
    exp, log = _arithmetic.exp, _arithmetic.log
else:
    from fmfts.arithmetic.elementary_reference import exp, log


def square(x: Any) -> Any:
    """x·x, of a number or an array."""
    return x * x


def power(x: Any, exponent: int) -> Any:
    """x·x·…, of a number or an array, `exponent` ≥ 1 times: what `**` makes of it goes through the C library's pow."""
    value = x
    for _ in range(exponent - 1):
        value = value * x
    return value
