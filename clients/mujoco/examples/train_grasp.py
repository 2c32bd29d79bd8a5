"""Trains the small policy of FmftsGrasp-v0 by CMA-ES: some minutes on two cores.

pip install './clients/mujoco[train]'
python clients/mujoco/examples/train_grasp.py -o grasp.json
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

import cma
import gymnasium
import numpy as np

import fmfts_mujoco  # noqa: F401  (registers the environment)
from fmfts_mujoco.policy import FEATURES, Policy, play


@cache
def environment() -> gymnasium.Env:
    """Made once in each process."""
    return gymnasium.make("FmftsGrasp-v0")


def loss(numbers: np.ndarray, seeds: list[int]) -> float:
    return -float(np.mean([play(environment(), Policy.of(numbers), seed).reward for seed in seeds]))


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("-o", "--output", type=Path, default=Path("grasp.json"))
    options.add_argument("--generations", type=int, default=10)
    options.add_argument("--episodes", type=int, default=5, help="of each policy in a generation")
    options.add_argument("--processes", type=int, default=2)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--start", type=Path, help="a policy from which it goes on, in smaller steps")
    chosen = options.parse_args()
    # First a hand closes to about a newton, and slowly lifts what it holds.
    start = np.zeros((2, len(FEATURES)))
    start[0, FEATURES.index("constant")], start[0, FEATURES.index("force")] = 1.0, -0.8
    start[1, FEATURES.index("weakest")] = 0.3
    if chosen.start is not None:
        start = Policy.load(chosen.start).weights
    step = 0.2 if chosen.start is None else 0.07
    search = cma.CMAEvolutionStrategy(start.ravel(), step, {"seed": chosen.seed, "popsize": 8, "verbose": -9})
    begun = time.monotonic()
    with ProcessPoolExecutor(chosen.processes) as processes:
        for generation in range(chosen.generations):
            first = 10_000 * chosen.seed + generation * chosen.episodes
            seeds = list(range(first, first + chosen.episodes))  # others in each, and equal for all in one
            tried = search.ask()
            losses = list(processes.map(loss, tried, [seeds] * len(tried)))
            search.tell(tried, losses)
            print(f"{time.monotonic() - begun:5.0f} s  generation {generation}: {-min(losses):.2f}", flush=True)
            Policy.of(search.result.xfavorite).save(chosen.output)


if __name__ == "__main__":
    main()
