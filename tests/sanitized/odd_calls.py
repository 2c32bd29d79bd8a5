"""Odd arguments to every function that the compiled parts export: it must answer, or raise an ordinary error.

    python tests/sanitized/odd_calls.py --calls 2000 [FUNCTION …]

Each call is one that the package makes, with one to three of its arguments changed: arrays of another size, of
infinities and NaN or of random bytes, read-only, not contiguous, beside an address for doubles, or no arrays at all;
and integers up to the largest. `make sanitize` runs it under the sanitizers, which end the process at the first access
outside of an array, and at the first integer that overflows.
"""

from __future__ import annotations

import argparse
import math
import random
import struct
import sys
import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from sanitized.calls import Call, functions, recorded

ORDINARY = (ValueError, TypeError, BufferError, ArithmeticError, AttributeError, MemoryError)
# Tables that only the package itself makes: C trusts their contents, and checks only their sizes.
OWN: dict[str, set[int]] = {
    "push": {0, 1, 2}, "host_time": {0}, "goes_on": {0}, "above_line": {0}, "restart": {0}, "judged": {0},
    "followed": {0}, "absent": {0}, "missing": {0}, "lent": {0, 1}, "track_field": {0, 1}, "predict": {0, 1},
    "covariance": {0, 1}, "poses": {0, 1}, "free_poses": {0, 1, 2}, "fit": {0, 1, 2}, "whitener": {0, 1},
    "chi2_with": {0, 1}, "estimate": {0}, "valley": {0, 1, 2, 6}, "best_single": {0, 1}, "best_pairs": {0, 1},
    "another": {0, 1}, "told_of_several": {0}, "calm": {0, 1},
}  # fmt: skip
# Number of repetitions: any number is valid, and a large one takes long.
TURNS = {("solve", 12), ("refine", 3), ("push", 17), ("push", 18)}
INTEGERS = (
    0, 1, -1, 2, 3, 7, 255, 2**15, 2**31 - 1, 2**31, -(2**31), 2**32, 2**53 - 1, 2**62 - 1, 1 - 2**62, 2**62,
    2**63 - 1, -(2**63), 2**64 - 1,
)  # fmt: skip
FLOATS = (0.0, -0.0, 1.0, -1.0, 0.5, 5e-324, 1e-300, 1e19, 1e300, -1e300, math.nan, math.inf, -math.inf)
OTHERS = (None, 0, 1.5, "text", b"", (), [], object)


def odd_bytes(data: bytes, dice: random.Random) -> bytes:
    """An array of another size, or with other numbers."""
    size = len(data)
    match dice.randrange(7):
        case 0:
            return data[: size - dice.choice((1, 2, 4, 8, 24, size, size // 2, size // 3))]
        case 1:
            return data + dice.randbytes(dice.choice((1, 4, 8, 24, 4096)))
        case 2:
            return data[: size - size % 8] * dice.choice((0, 2, 3))
        case 3:
            return dice.randbytes(size)
        case _:
            changed = bytearray(data)
            for _ in range(dice.choice((1, 1, 2, 5, 1 + size // 8))):
                if size >= 8:
                    struct.pack_into("d", changed, 8 * dice.randrange(size // 8), dice.choice(FLOATS))
                elif size:
                    changed[dice.randrange(size)] = dice.randrange(256)
            return bytes(changed)


def odd_array(data: bytes | bytearray, dice: random.Random, own: bool) -> Any:
    """A buffer that is no such array, or an array with other contents; own: only of another size."""
    match dice.randrange(12):
        case 0:
            return memoryview(bytearray(2 * len(data)))[::2]
        case 1:
            return memoryview(bytearray(b"\0" + bytes(data)))[1:]
        case 2:
            return memoryview(bytes(data))
        case 3:
            return dice.choice(OTHERS)
    changed = odd_bytes(bytes(data), dice)
    if own and len(changed) == len(data):
        return data
    return changed if isinstance(data, bytes) else bytearray(changed)


def odd(argument: Any, dice: random.Random, own: bool, most: int) -> Any:
    """Replaces this argument by something else."""
    if isinstance(argument, tuple):
        changed = list(argument)
        place = dice.randrange(len(changed) + 1)
        if place == len(changed):
            return tuple(changed[: dice.randrange(place + 1)])
        changed[place] = odd(changed[place], dice, own, most)
        return tuple(changed)
    if isinstance(argument, bytes | bytearray):
        return odd_array(argument, dice, own)
    if dice.randrange(8) == 0:
        return dice.choice(OTHERS)
    if isinstance(argument, float):
        return dice.choice(FLOATS)
    return dice.choice([integer for integer in INTEGERS if integer <= most])


def fresh(argument: Any) -> Any:
    """The same, with copies of what a call may write."""
    if isinstance(argument, tuple):
        return tuple(fresh(each) for each in argument)
    return bytearray(argument) if isinstance(argument, bytearray) else argument


def odd_call(call: Call, dice: random.Random) -> tuple[Any, ...]:
    arguments = list(call.arguments)
    for _ in range(dice.choice((1, 1, 2, 3))):
        place = dice.randrange(len(arguments))
        own, turns = place in OWN.get(call.name, set()), (call.name, place) in TURNS
        arguments[place] = odd(arguments[place], dice, own, 255 if turns else 2**64)
    if dice.randrange(20) == 0:
        del arguments[dice.randrange(len(arguments))]
    return tuple(arguments)


def tried(calls: Sequence[Call], count: int, show: bool = False) -> Counter[str]:
    """The outcomes of this many odd calls, by the kind of error. Raises any error that is not ordinary."""
    dice = random.Random(zlib.crc32(calls[0].name.encode()))
    outcome = Counter[str]()
    for number in range(count):
        call = dice.choice(calls)
        arguments = odd_call(call, dice)
        if show:
            print(number, call.name, arguments, flush=True)
        try:
            call.function(*fresh(arguments))
        except ORDINARY as error:
            outcome[type(error).__name__] += 1
        else:
            outcome["answered"] += 1
    return outcome


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--calls", type=int, default=2000, help="of each function")
    parser.add_argument("--show", action="store_true", help="print each call before it is made")
    parser.add_argument("functions", nargs="*", help="only these")
    options = parser.parse_args()
    calls = recorded()
    for module, name in functions():
        if not options.functions or name in options.functions:
            print(f"{module}.{name}: {dict(tried(calls[module, name], options.calls, options.show))}", flush=True)


if __name__ == "__main__":
    main()
