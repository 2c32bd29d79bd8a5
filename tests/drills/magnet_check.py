"""`make magnet-check`: random mistakes of boards, and good boards, before a person with one magnet.

    .venv/bin/python tests/drills/magnet_check.py --seed 1 --mistakes 200 --good 50

Prints a table by kind of mistake. Ends with an error if fewer than 95 % are named, or a good board is accused. It is
no part of `make test`, which does a few of the same. tests/unit/magnet_world.py says where the fields come from.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

for folder in (".", "unit"):
    sys.path.insert(0, str(Path(__file__).parents[1] / folder))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from magnet_mistakes import MISTAKES, Outcome, tried, two_scaled  # noqa: E402

REQUIRED = 0.95
OUTCOMES = ("named", "open", "wrong name", "good", "false accusation")


def one(case: tuple[int, int, int, float]) -> Outcome:
    """case: seed, number, which mistake (−1 for none), and how clumsy the person is."""
    seed, number, which, clumsy = case
    kinds = (*MISTAKES, two_scaled)
    return tried((seed, number), None if which < 0 else kinds[which], clumsy)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mistakes", type=int, default=200)
    parser.add_argument("--good", type=int, default=50)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--clumsy", type=float, default=1.0, help="times as far off as 5 mm and 15° (1)")
    parser.add_argument("--more", action="store_true", help="also boards with two wrong scales, which are not counted")
    parser.add_argument("--show", action="store_true", help="say what was said where it is not named")
    options = parser.parse_args()
    cases = [(options.seed, number, number % len(MISTAKES)) for number in range(options.mistakes)]
    cases += [(options.seed, 100_000 + number, -1) for number in range(options.good)]
    if options.more:
        cases += [(options.seed, 200_000 + number, len(MISTAKES)) for number in range(20)]
    table: defaultdict[str, Counter[str]] = defaultdict(Counter)
    with ProcessPoolExecutor(options.processes) as executor:
        for case, outcome in zip(cases, executor.map(one, [(*case, options.clumsy) for case in cases]), strict=True):
            table[outcome.kind][outcome.verdict] += 1
            table[outcome.kind]["repeated"] += outcome.repeated
            if options.show and outcome.verdict not in ("named", "good"):
                print(f"{case}: {outcome.kind}: {outcome.verdict}: {outcome.said}", flush=True)
    columns = (*OUTCOMES, "repeated")
    print(f"{'seed ' + str(options.seed):36}" + "".join(f"{each:>18}" for each in columns))
    for kind, counts in table.items():
        print(f"{kind:36}" + "".join(f"{counts[each]:18}" for each in columns))
    counted = Counter(dict.fromkeys(columns, 0))
    for kind, counts in table.items():
        if kind != "factor 2 or 0.5 of two chips":
            counted += counts
    share = counted["named"] / max(options.mistakes, 1)
    print(f"named: {counted['named']} of {options.mistakes} ({share:.1%}); accused: {counted['false accusation']} of "
          f"{options.good} good boards, {counted['good']} found good")  # fmt: skip
    return int(share < REQUIRED or counted["false accusation"] > 0)


if __name__ == "__main__":
    sys.exit(main())
