"""Computes exp and log with the same bits on every processor.

The C library and NumPy do not: they choose variants of exp, log and pow by the processor (fused multiply-add, wide
vectors), and these round differently. The functions here (elementary.h) use only +, −, × and ÷, which IEEE 754 rounds
the same everywhere.
"""

from __future__ import annotations

from typing import Any

from fmfts.arithmetic._arithmetic import exp, log

__all__ = ["exp", "log", "power", "square"]


def square(x: Any) -> Any:
    """x·x of a number or an array."""
    return x * x


def power(x: Any, exponent: int) -> Any:
    """x to the power of `exponent` ≥ 1, for a number or an array, by multiplication: `**` calls the C library's pow."""
    value = x
    for _ in range(exponent - 1):
        value = value * x
    return value
