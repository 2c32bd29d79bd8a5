"""How far two ways of judging the same frames differ: `python -m golden.beside [--messages N] [WORLD…]`.

The compiled path beside Python alone, and beside itself with a snapshot every 500th frame, as where somebody begins to
record: the largest difference of each kind of number, in its own published deviations and in SI.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from itertools import islice

from golden.replayed import Way, answers
from golden.said import deviation_of, split
from golden.world import load, names

OTHERS = {"Python": Way(in_c=False), "snapshots": Way(snapshots=500)}


@dataclass(slots=True)
class Beside:
    """largest: name of a number without places → (in deviations, in SI)."""

    messages: int = 0
    words: int = 0
    largest: dict[str, tuple[float, float]] = field(default_factory=dict)


def beside(name: str, way: Way, most: int) -> Beside:
    found = Beside()
    pairs = zip(answers(load(name)[0]), answers(load(name)[0], way), strict=True)
    for (_, one, sent_ns), (_, other, _) in islice(pairs, most):
        found.messages += 1
        if one is None or other is None:
            found.words += one is not other
            continue
        (words, numbers), (other_words, other_numbers) = split(one, sent_ns), split(other, sent_ns)
        found.words += words != other_words
        for key, value in numbers.items():
            deviation = numbers.get(deviation_of(key), 0.0)
            off = abs(value - other_numbers.get(key, value))
            if off > 0.0 and deviation > 0.0 and deviation_of(key) != key:
                kind = key.partition("[")[0]
                before = found.largest.get(kind, (0.0, 0.0))
                found.largest[kind] = max(before[0], off / deviation), max(before[1], off)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("worlds", nargs="*")
    parser.add_argument("--messages", type=int, default=1000)
    options = parser.parse_args()
    for name in options.worlds or names():
        for other, way in OTHERS.items():
            found = beside(name, way, options.messages)
            worst = sorted(found.largest.items(), key=lambda one: -one[1][0])[:3]
            told = ", ".join(f"{kind} {sd:.1e} sd ({si:.1e})" for kind, (sd, si) in worst)
            print(f"{name:20} {other:10} {found.messages:6d} messages, {found.words} other words: {told}", flush=True)


if __name__ == "__main__":
    main()
