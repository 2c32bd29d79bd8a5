"""A message is refused if one number in its bytes is NaN or infinite: finite.h against msgspec's own decoder."""

from __future__ import annotations

import math
import random
from typing import Any

import msgspec
import pytest

from fmfts.arithmetic._arithmetic import has_finite_numbers
from fmfts.bus.encoding import not_finite_field

# Text and numbers whose bytes look like the type of a double.
ODD_TEXT = ["", "a" * 31, "b" * 32, "c" * 300, "d" * 70000, "\x7f", "Ëð"]
ODD_NUMBERS = [0, -1, -33, 203, 0xCB7FF0, 2**40, -(2**40), 2**63, 1.5, -0.0, 1e308, 5e-324]


def anything(source: random.Random, depth: int) -> Any:
    kind = source.randrange(7 if depth else 4)
    if kind == 0:
        return source.choice(ODD_NUMBERS)
    if kind == 1:
        return source.choice(ODD_TEXT)
    if kind == 2:
        return source.choice([None, True, False, b"\xcb" + b"\xff" * source.randrange(300)])
    if kind == 3:
        return source.uniform(-1e9, 1e9)
    some = [anything(source, depth - 1) for _ in range(source.choice([0, 1, 15, 16, 40]))]
    return some if kind < 6 else {str(number): each for number, each in enumerate(some)}


@pytest.mark.parametrize("seed", range(40))
def test_only_floats_that_are_not_finite_are_found(seed: int) -> None:
    source = random.Random(seed)
    good = [anything(source, 2) for _ in range(4)]
    assert not not_finite_field(good)
    assert has_finite_numbers(msgspec.msgpack.encode(good))
    bad = [*good, {"x": source.choice([math.nan, -math.nan, math.inf, -math.inf])}, *good]
    assert not has_finite_numbers(msgspec.msgpack.encode(bad))


def test_bytes_that_are_cut_off_or_no_message_are_not_finite() -> None:
    whole = msgspec.msgpack.encode([1.5, "text", 7])
    assert has_finite_numbers(whole)
    assert not has_finite_numbers(whole[:5])
    assert not has_finite_numbers(b"\xc7\x01\x01\x00")
