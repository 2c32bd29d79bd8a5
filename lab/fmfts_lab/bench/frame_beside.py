"""Time of a frame of the pad with one magnet, beside another build: `bench frame --beside FOLDER`.

FOLDER holds the other build's package `fmfts`: a wheel that was unpacked. Each build runs in a process of its own, and
they take turns, so that other work of the computer delays both alike.
"""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np

TURNS = 150
# From a frame to its encoded message. It waits for a line, takes a turn of 100 frames, and says its processor time.
WORKER = """
import sys, time
import fmfts
try:
    from fmfts.bus.encoding import encode
except ImportError:  # of older builds
    from fmfts.bus.messages import encode
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.simulation.baseline import simulated_baseline
from fmfts.simulation.source import Simulated
config = PadConfig(name="bench", source=SimulatedSource(seed=1))
pipeline = pipeline_of(config, contact_model_of(config), "bench")
pipeline.use(simulated_baseline(config))
source, step = Simulated(config), 0
print(fmfts.__file__, flush=True)
for _ in sys.stdin:
    frames = []
    while len(frames) < 100:
        frames.extend(source.poll(round(step * 1e9 / 220)))
        step += 1
    begun = time.process_time_ns()
    for frame in frames:
        encode(pipeline.process(frame))
    print(time.process_time_ns() - begun, flush=True)
"""


def run(other: Path) -> None:
    """Print the ratio of this build's time to the other's. SystemExit where FOLDER has no package."""
    if not (other / "fmfts/__init__.py").is_file():
        raise SystemExit(f"{other}: holds no package fmfts; unpack a wheel of the other build there")
    with ExitStack() as stack:
        both = [stack.enter_context(_worker(path)) for path in (None, other)]
        where = [_line(worker) for worker in both]
        if not Path(where[1]).is_relative_to(other.resolve()) or where[0] == where[1]:
            raise SystemExit(f"{other}: the other process uses {where[1]}")
        taken = np.empty((TURNS, 2))
        for turn in range(TURNS):
            for which in (turn % 2, 1 - turn % 2):
                print(file=both[which].stdin, flush=True)
                taken[turn, which] = float(_line(both[which]))
        for worker in both:
            assert worker.stdin is not None
            worker.stdin.close()
    fastest = taken.min(axis=0)
    print(
        f"frame to message, this build beside the other: {fastest[0] / fastest[1]:.3f} of its time (fastest turns), "
        f"{np.median(taken[:, 0] / taken[:, 1]):.3f} (median of {TURNS} pairs); {fastest[0] * 1e-5:.1f} µs a frame"
    )


def _worker(other: Path | None) -> subprocess.Popen[str]:
    environment = os.environ | ({} if other is None else {"PYTHONPATH": str(other.resolve())})
    command = [sys.executable, "-W", "ignore", "-c", WORKER]
    return subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def _line(worker: subprocess.Popen[str]) -> str:
    assert worker.stdout is not None
    line = worker.stdout.readline()
    if not line:
        raise SystemExit(f"a build ended with {worker.wait()}")
    return line.strip()
