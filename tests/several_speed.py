"""`python tests/several_speed.py`: how long the estimator of several magnets takes, call by call, in µs.

Four magnets, eight sensors, 48 causes of errors, a table of 15 × 15 knots. The least of several runs. A warm fit starts
at the finger's place one frame before, 0.05 mm and 0.01 N off.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent / "unit"))

from several_world import measured_of, models_of

from fmfts.several.fit import Fitter

RUNS = 9
TRUE = np.array([[-8.0, -3.0, 1.0], [7.0, 2.0, 0.8]])
NONE = np.zeros(3)


def least_us(call: Callable[[], object]) -> float:
    """The least mean over a run, of RUNS; each takes about 20 ms."""
    begun = time.perf_counter()
    call()
    count = max(1, int(0.02 / (time.perf_counter() - begun)))
    best = np.inf
    for _ in range(RUNS):
        begun = time.perf_counter()
        for _ in range(count):
            call()
        best = min(best, (time.perf_counter() - begun) / count)
    return float(1e6 * best)


def cold(fitter: Fitter, root: np.ndarray, measured: object) -> None:
    for start in fitter.best_pairs(root, measured):  # type: ignore[arg-type]
        fitter.fit(start, measured, NONE)  # type: ignore[arg-type]


def main() -> None:
    fitter = Fitter(models_of(1, knots=15, terms=1))
    random = np.random.default_rng(1)
    print("µs")
    for count in range(3):
        fingers = TRUE[:count]
        measured = measured_of(random, fitter.model, fingers)
        start = fingers + np.array([0.05, -0.05, 0.01])
        root = fitter.whitener(fingers, measured, NONE)
        for name, call in {
            "warm fit": lambda at=start, of=measured: fitter.fit(at, of, NONE),
            "whitener": lambda at=start, of=measured: fitter.whitener(at, of, NONE),
            "chi2_with": lambda by=root, at=start, of=measured: fitter.chi2_with(by, at, of),
            "best_single": lambda by=root, of=measured: fitter.best_single(by, of),
            "best_pairs": lambda by=root, of=measured: fitter.best_pairs(by, of),
        }.items():
            print(f"K = {count}  {name:12} {least_us(call):8.1f}")
    measured = measured_of(random, fitter.model, TRUE)
    root = fitter.whitener(TRUE[:0], measured, NONE)
    print(f"cold: best_pairs and three fits of two {least_us(lambda: cold(fitter, root, measured)):8.1f}")


if __name__ == "__main__":
    main()
