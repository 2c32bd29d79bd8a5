"""Time of frames that search fingers: the first ones that nothing explains, of one pad, and of many at once.

Each frame counts with the least of its times in RUNS runs of the same frames, so that other programs hardly count: each
run computes the same.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import msgspec
import numpy as np

from fmfts.baseline import Baseline
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pipeline.configured import contact_model_of, pipeline_of
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.runtime.search_turns import turns_of
from fmfts.sensor import Frame
from fmfts_lab.bench.several_faults import BesideTool
from fmfts_lab.bench.tool_ways import Tool, Way
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, no_finger, steady_finger

RATE_HZ, RUNS, SEEDS = 220, 3, 3
FRAMES = 330  # meanwhile a magnet is put down beside the pad
PRESSED: dict[str, tuple[Finger, Finger | None]] = {
    "no finger": (no_finger, None),
    "one finger": (steady_finger(3e-3, -4e-3, 1.0), None),
    "two fingers": (steady_finger(-6e-3, -2e-3, 1.0), steady_finger(8e-3, 1e-3, 0.7)),
}


class Recorded:
    """The frames of a pad with four magnets beside which one is put down, and pipelines for them."""

    def __init__(self, seed: int, fingers: tuple[Finger, Finger | None]) -> None:
        config = array_config(seed=seed)
        assert isinstance(config.source, SimulatedSource)
        self.config: PadConfig = msgspec.structs.replace(
            config, source=msgspec.structs.replace(config.source, finger="none")
        )
        source = BesideTool(self.config)
        source.finger, source.second_finger = fingers
        source.tool = Tool(Way("put down", 0.06, 1.0), 0.2, np.random.default_rng(seed))
        self.frames: list[Frame] = [
            frame for step in range(FRAMES) for frame in source.poll(round(step * 1e9 / RATE_HZ))
        ]
        self.baseline: Baseline = simulated_baseline(self.config)
        self.mounting: ArrayMounting = self.baseline.array_mounting(self.config.pad())

    def pipeline(self) -> SeveralPipeline:
        made = pipeline_of(self.config, contact_model_of(self.config), "speed")
        assert isinstance(made, SeveralPipeline)
        made.use(self.baseline, self.mounting)
        return made


def run(pads: int) -> None:
    """Print both tables. pads: how many at once."""
    print("\n| the first frames that nothing explains | searches | median ms | p99 ms | worst ms |")
    print("| --- | --- | --- | --- | --- |")
    every = []
    for name, fingers in PRESSED.items():
        found = np.concatenate([alone(Recorded(seed, fingers)) for seed in range(1, SEEDS + 1)])
        every.append(found)
        _print(name, found)
    _print("all", np.concatenate(every))
    print(
        f"\n| {pads} pads beside steel at once | searched in a round of frames, at most | frames that waited | "
        "not `ok`, of these | longest wait, frames | a round, median ms | worst ms |\n"
        "| --- | --- | --- | --- | --- | --- | --- |"
    )
    for name, fingers in PRESSED.items():
        print(f"| {name} | {together(Recorded(1, fingers), pads)} |", flush=True)


def alone(recorded: Recorded) -> np.ndarray:
    """The times (ms) of the frames that searched."""
    times, searched = np.full((RUNS, len(recorded.frames)), np.inf), np.zeros(len(recorded.frames), dtype=bool)
    for which in range(RUNS):
        pipeline = recorded.pipeline()
        for number, frame in enumerate(recorded.frames):
            begun = time.process_time_ns()
            pipeline.answer(frame)
            times[which, number] = (time.process_time_ns() - begun) * 1e-6
            searched[number] = pipeline.search == "made"
    return np.asarray(times.min(axis=0)[searched])


def together(recorded: Recorded, pads: int) -> str:
    """All pads get the same frames in the same order, as boards that began together send them."""
    rounds_ms = np.empty((RUNS, len(recorded.frames)))
    for which in range(RUNS):
        pipelines = [recorded.pipeline() for _ in range(pads)]
        turns, since = turns_of(pipelines), np.zeros(pads, dtype=int)
        made, waited, ok, longest = list[bool](), 0, 0, 0
        for number, frame in enumerate(recorded.frames):
            begun = time.process_time_ns()
            for pad, pipeline in enumerate(pipelines):
                message = pipeline.answer(turns.allowed(str(pad), frame))
                turns.told(str(pad), pipeline.search)
                made.append(pipeline.search == "made")
                since[pad] = since[pad] + 1 if pipeline.search == "due" else 0
                waited, ok = (
                    waited + (pipeline.search == "due"),
                    ok + (pipeline.search == "due" and message.health == "ok"),
                )
                longest = max(longest, int(since[pad]))
            rounds_ms[which, number] = (time.process_time_ns() - begun) * 1e-6
    least = rounds_ms.min(axis=0)
    return f"{_most(made, pads)} | {waited} | {waited - ok} | {longest} | {np.median(least):.2f} | {least.max():.2f}"


def _most(made: Sequence[bool], pads: int) -> int:
    """The most searches in any `pads` frames in a row."""
    return int(np.convolve(np.array(made, dtype=int), np.ones(pads, dtype=int)).max())


def _print(name: str, found: np.ndarray) -> None:
    told = np.median(found), np.quantile(found, 0.99), found.max()
    print(f"| {name} | {len(found)} | {' | '.join(f'{value:.2f}' for value in told)} |", flush=True)
