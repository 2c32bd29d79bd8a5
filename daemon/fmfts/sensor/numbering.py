"""The numbers of frames and packets: each is one more than the last, and after the largest they begin anew."""

from __future__ import annotations

NUMBERS = 2**32  # firmware/wire.md
MOST_MISSING = 1 << 16  # five minutes at 220 Hz: longer than any computer stalls


def missing(number: int, before: int) -> int:
    """How many numbers are missing between two. More than MOST_MISSING if `number` came before, or is impossible."""
    return (number - before - 1) % NUMBERS


def is_next(number: int, before: int) -> bool:
    """Whether `number` follows `before`; the number of a repeated packet does not."""
    return missing(number, before) <= MOST_MISSING
