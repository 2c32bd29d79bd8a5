"""Lifts objects in real time: the daemon and the example are processes of their own, as on a robot.

python -m fmfts_mujoco.lift_over_bus --lifts 6 --seed 1
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
from fmfts_client import Contact

from fmfts_mujoco.bench import go_before_others
from fmfts_mujoco.daemon import Daemon
from fmfts_mujoco.grip import CONFIG, Ended, ended, line
from fmfts_mujoco.lifting import Lifting
from fmfts_mujoco.objects import Object
from fmfts_mujoco.over_bus import Robot
from fmfts_mujoco.rivals import example
from fmfts_mujoco.setting_up import baselines

PADS = ("left_pad", "right_pad")
PATIENCE_S = 60.0


class Gripping:
    """The example in its own process (`gripping.py`), as `Lifting` calls a controller. Its commands come when they do:
    the gripper follows the newest one."""

    def __init__(self, endpoint: str) -> None:
        words = [sys.executable, "-m", "fmfts_mujoco.gripping", *PADS]
        surroundings = os.environ | {"FMFTS_BUS": endpoint}
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=surroundings)
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)
        self.found, self.commands, self._left, self._loosens = False, 0, b"", False
        self._newest = example().Command(0.0, False)

    def step(self, _: list[Contact | None], loosen: bool, period_s: float) -> Any:
        assert self._process.stdin is not None
        if loosen != self._loosens:
            self._loosens = loosen
            self._process.stdin.write(b"%d" % loosen)
            self._process.stdin.flush()
        self._listen()
        return self._newest

    def wait(self) -> None:
        """Wait until the controller commands something. RuntimeError if it does not."""
        until = time.monotonic() + PATIENCE_S
        while not self.commands:
            if time.monotonic() > until or self._process.poll() is not None:
                raise RuntimeError(f"gripping.py commands nothing within {PATIENCE_S:g} s; what it said is above")
            time.sleep(0.01)
            self._listen()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        *lines, self._left = (self._left + (self._process.stdout.read() or b"")).split(b"\n")
        self.commands += len(lines)
        if lines:
            speed, lifts, found = lines[-1].split()
            self._newest, self.found = example().Command(float(speed), lifts == b"1"), found == b"1"

    def __enter__(self) -> Gripping:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()


class OverBus(Lifting):
    """The example hears the pads by itself."""

    def _contacts(self, usable: Any) -> list[Contact | None]:
        return []


@contextmanager
def pads_on_bus(daemon: Daemon, seed: int, made: list[Robot]) -> Iterator[Any]:
    """Makes them for `Lifting`, with the baselines of a robot that was turned; closes them."""

    def make(model: mujoco.MjModel, data: mujoco.MjData) -> Robot:
        robot = Robot(model, data, daemon.config, daemon.endpoint, seed=seed)
        made.append(robot)
        robot.baselines = baselines(robot.scene, data, turned=True)
        robot.scene.start(np.random.default_rng(seed))
        daemon.start(robot)
        return robot

    try:
        yield make
    finally:
        for robot in made:
            robot.close()


def lift(number: int, seed: int) -> tuple[Ended, int, float]:
    """One, of the same object as `grip.lift`; how often this computer was late; commands a second."""
    made: list[Robot] = []
    thing = Object.drawn(np.random.default_rng([seed, number]))
    with Daemon(CONFIG) as daemon, pads_on_bus(daemon, number, made) as make:
        lifting = OverBus(thing, make)
        with Gripping(daemon.endpoint) as gripping:
            gripping.wait()
            began_s, before = time.monotonic(), gripping.commands
            done = lifting.run(gripping, None)
            rate_hz = (gripping.commands - before) / (time.monotonic() - began_s)
        return ended(done), made[0].late, rate_hz


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--lifts", type=int, default=6)
    options.add_argument("--seed", type=int, default=1)
    chosen = options.parse_args()
    go_before_others()
    ends = []
    for number in range(chosen.lifts):
        end, late, rate_hz = lift(number, chosen.seed)
        print(f"{number} {end}; {rate_hz:.0f} commands a second, late {late} times", flush=True)
        ends.append(end)
    print(line("over the bus", ends))


if __name__ == "__main__":
    main()
