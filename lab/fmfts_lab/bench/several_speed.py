"""Time of a frame of a pad with four magnets: the search for fingers, the magnets' poses, from a frame to its message.

It is the processor's time, so that a busy computer tells nearly the same as a quiet one.
"""

from __future__ import annotations

import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial

import msgspec
import numpy as np

from fmfts.config import SimulatedSource
from fmfts.pipeline.configured import Pipeline, contact_model_of, pipeline_of
from fmfts.pipeline.encoded import EncodedMessage
from fmfts.sensor import Frame
from fmfts.several.poses import poses_of
from fmfts_lab.bench import several_searches
from fmfts_lab.bench.several_faults import BesideTool
from fmfts_lab.bench.several_world import BUILT, Press, world
from fmfts_lab.bench.tool_ways import Tool, Way
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, no_finger, steady_finger

NOTHING = np.zeros(3)
PADS = 16
WARM_FRAMES = 30
SINGLE, PAIR = [Press(3.0, -4.0, 1.0)], [Press(-6.0, -2.0, 1.0), Press(8.0, 1.0, 0.7)]
FINGERS: dict[str, tuple[Finger, Finger | None]] = {
    "no finger": (no_finger, None),
    "one finger": (steady_finger(3e-3, -4e-3, 1.0), None),
    "one finger near the rim": (steady_finger(10e-3, -8e-3, 0.7), None),
    "two fingers": (steady_finger(-6e-3, -2e-3, 1.0), steady_finger(8e-3, 1e-3, 0.7)),
    "two fingers, one near the rim": (steady_finger(4e-3, -5e-3, 1.6), steady_finger(-9.5e-3, -9.5e-3, 0.4)),
    "disturbed": (no_finger, None),
}
# A magnet is put down beside the pad after one and a half seconds, and stays there.
DISTURBING, LIES_FRAMES = (Way("put down", 0.06, 1.0), 0.2), 330


def run(options: Namespace) -> None:
    print("| frame | median ms | p99 ms | least ms |\n| --- | --- | --- | --- |")
    _searches(options)
    _poses(options)
    _chains(options)
    several_searches.run(PADS)


def _searches(options: Namespace) -> None:
    one = world(options.seed, BUILT)
    quiet: list[Press] = []
    for name, presses, warm in (
        ("search: no finger", quiet, True),
        ("search: one finger, warm", SINGLE, True),
        ("search: two fingers, warm", PAIR, True),
        ("search: a finger appears", SINGLE, False),
        ("search: two fingers appear", PAIR, False),
    ):
        change, counter = one.pressed(presses), one.counter()
        times = []
        for _ in range(options.repeats):
            measured = one.measured(change)
            if not warm:
                counter.forget()
            times.append(_seconds(partial(counter.update, measured, NOTHING)))
        _print(name, times)


def _poses(options: Namespace) -> None:
    """Where the magnets are, once the fingers are known."""
    one = world(options.seed, BUILT)
    for name, presses in (("one finger", SINGLE), ("two fingers", PAIR)):
        measured = one.measured(one.pressed(presses))
        fit = one.fitter.fit(np.array([press[:3] for press in presses]), measured, NOTHING)
        work = partial(poses_of, one.fitter, fit, measured, NOTHING)
        _print(f"poses: {name}", [_seconds(work) for _ in range(options.repeats)])


def _chains(options: Namespace) -> None:
    """From a frame to the bytes that are sent, in one thread."""
    medians = {}
    for name, fingers in FINGERS.items():
        config = array_config(seed=options.seed)
        assert isinstance(config.source, SimulatedSource)
        config = msgspec.structs.replace(config, source=msgspec.structs.replace(config.source, finger="none"))
        pipeline = pipeline_of(config, contact_model_of(config), "speed")
        pipeline.use(simulated_baseline(config))
        source, before = BesideTool(config), WARM_FRAMES
        source.finger, source.second_finger = fingers
        if name == "disturbed":
            source.tool, before = Tool(*DISTURBING, np.random.default_rng(options.seed)), LIES_FRAMES
        frames: list[Frame] = []
        for step in range(options.repeats + before):
            frames.extend(source.poll(round(step * 1e9 / 220)))
        for frame in frames[:before]:
            message = pipeline.process(frame)
        assert (message.health == "disturbed") == (name == "disturbed"), message.reason
        times = [_seconds(partial(_sent, pipeline, frame)) for frame in frames[before:]]
        medians[name] = _print(f"frame to message: {name}", times)
    half = (medians["no finger"] + medians["one finger"]) / 2.0
    print(f"\n{PADS} pads at 220 Hz, half of them with a finger: {PADS * 220 * half * 1e-3:.0%} of a core")


def _sent(pipeline: Pipeline, frame: Frame) -> bytes:
    answer = pipeline.answer(frame)
    assert isinstance(answer, EncodedMessage)
    return answer.payload


def _seconds(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun


def _print(name: str, times: list[float]) -> float:
    """Prints the row. Returns the median in ms."""
    told = np.array(times[1:]) * 1e3
    median = float(np.median(told))
    print(f"| {name} | {median:.3f} | {np.quantile(told, 0.99):.3f} | {told.min():.3f} |", flush=True)
    return median
