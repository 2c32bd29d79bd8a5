"""Runs a trained policy in this process and against a daemon over the bus, with the same objects, and says how it went.

python -m fmfts_mujoco.compare --episodes 50
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gymnasium
import numpy as np

from fmfts_mujoco.bench import go_before_others
from fmfts_mujoco.daemon import Daemon
from fmfts_mujoco.grasp import CONFIG, GraspEnv
from fmfts_mujoco.over_bus import Robot
from fmfts_mujoco.policy import TRAINED, Episode, Policy, play


def in_process(policy: Policy, seeds: range) -> list[Episode]:
    environment = gymnasium.make("FmftsGrasp-v0")
    return [play(environment, policy, seed) for seed in seeds]


def over_bus(policy: Policy, seeds: range) -> list[Episode]:
    """Episodes over the bus in real time: each takes 2.4 s, and on a busy computer the pads are late."""
    go_before_others()
    with Daemon(CONFIG) as daemon:
        environment = gymnasium.make("FmftsGrasp-v0", config=daemon.config, endpoint=daemon.endpoint)
        whole = environment.unwrapped
        assert isinstance(whole, GraspEnv)
        assert isinstance(whole.pads, Robot)
        daemon.start(whole.pads)
        episodes = [play(environment, policy, seed) for seed in seeds]
        if whole.pads.late:
            print(f"this computer was too slow for real time {whole.pads.late} times, which is no fault of the bus")
        environment.close()
        return episodes


def told(episodes: list[Episode]) -> str:
    success, forces = [each.success for each in episodes], [each.strongest_n for each in episodes]
    return f"{100.0 * np.mean(success):.1f} % of {len(success)} succeed, {np.mean(forces):.2f} N at the most on average"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--policy", type=Path, default=TRAINED)
    options.add_argument("--episodes", type=int, default=50)
    chosen = options.parse_args()
    policy, seeds = Policy.load(chosen.policy), range(chosen.episodes)
    here, there = in_process(policy, seeds), over_bus(policy, seeds)
    print(f"in process:   {told(here)}")
    print(f"over the bus: {told(there)}")
    same = np.mean([one.success == other.success for one, other in zip(here, there, strict=True)])
    print(f"the same end: {100.0 * same:.1f} %")


if __name__ == "__main__":
    main()
