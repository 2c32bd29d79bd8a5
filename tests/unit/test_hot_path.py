"""From counts to the encoded message no Python runs and nothing is allocated but the message, whatever the health."""

from __future__ import annotations

import gc
import re
import sys
import tracemalloc
from collections import Counter
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from test_compiled import headers

import fmfts
from fmfts.common.toml import parse
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.sensor import Frame
from golden.replayed import pipelines_of
from golden.world import load

ROOT = Path(__file__).parents[2]
# Frozen worlds, the number of their first frames, and the healths of these.
WORLDS = {
    "faulty": (1500, {"ok", "degraded", "lost"}),
    "steel-faulty": (750, {"ok", "degraded", "disturbed", "lost"}),
    "bare": (100, {"no_baseline"}),
    "neighbours": (300, {"ok"}),
    "samples": (300, {"ok"}),
    "without-model": (100, {"ok"}),
}
WARM = 60  # frames, after which the interpreter has specialised its calls
OF_MEASURING = 64  # bytes: two integers
# The interpreter allocates something of its own once in fifty calls.
OF_THE_INTERPRETER = 0.1
ALLOCATES = re.compile(r"\b(\w*alloca?|free|strn?dup|Py\w+)\(|<Python\.h>")


class Judged:
    """The pad of a world, and what it judges in turn: frames, and after each a sample that came before the next."""

    healths: set[str]

    def __init__(self, pipeline: PadPipeline) -> None:
        self.pad = pipeline._compiled
        self.calls: list[tuple[Any, tuple[Any, ...]]] = []

    def add(self, frame: Frame) -> None:
        temperature_c = np.nan if frame.temperature_c is None else frame.temperature_c
        times = frame.device_time_us, frame.host_time_ns
        self.calls.append((self.pad.judge, (*frame.packed, frame.sequence, *times, temperature_c)))
        early = 1, frame.gain_code, 100, -200, 50, frame.device_time_us + 2000
        self.calls.append((self.pad.early, early))

    def measured(self) -> list[tuple[str, int, int]]:
        """For each call the health of the last message, and the bytes beyond the answer that it kept and needed."""
        found, answer = [], None
        for call, arguments in self.calls:
            del answer
            tracemalloc.reset_peak()
            before, _ = tracemalloc.get_traced_memory()
            answer = call(*arguments)
            after, peak = tracemalloc.get_traced_memory()
            size = 0 if answer is None else sys.getsizeof(answer)
            last = self.pad.last
            assert last is not None
            found.append((last[0], after - before - size, peak - before - size))
        return found


@pytest.fixture(params=WORLDS)
def judged(request: pytest.FixtureRequest) -> Any:
    world = load(request.param)[0]
    pad = world.pads[0]
    with pipelines_of(world) as pipelines:
        pipeline = pipelines[pad.settings.name]
        assert isinstance(pipeline, PadPipeline)
        made = Judged(pipeline)
        frames, made.healths = WORLDS[request.param]
        for _, events in islice(pad.events(), frames):
            made.add(next(event for event in events if isinstance(event, Frame)))
        yield made


def test_judging_allocates_the_message_and_nothing_else(judged: Judged) -> None:
    gc.disable()
    tracemalloc.start()
    try:
        found = judged.measured()[WARM:]
    finally:
        tracemalloc.stop()
        gc.enable()
    kinds = Counter(health for health, _, _ in found)
    exact = Counter(health for health, kept, needed in found if kept == 0 and needed <= OF_MEASURING)
    for health, count in kinds.items():
        assert count - exact[health] <= max(OF_THE_INTERPRETER * count, 2), health
    assert set(kinds) == judged.healths


def test_judging_runs_no_python(judged: Judged) -> None:
    events: Counter[tuple[str, str]] = Counter()

    def profile(frame: FrameType, event: str, argument: Any) -> None:
        events[event, argument.__name__ if event.startswith("c_") else frame.f_code.co_name] += 1

    calls = judged.calls
    sys.setprofile(profile)
    for call, arguments in calls:
        call(*arguments)
    sys.setprofile(None)
    del events["c_call", "setprofile"]
    half = len(calls) // 2
    assert events == {(event, name): half for event in ("c_call", "c_return") for name in ("judge", "early")}


def test_steps_of_a_frame_know_no_allocator_and_no_python() -> None:
    """Of all that pyproject.toml compiles into the pad, only the files that begin with _ do."""
    modules = parse((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["ext-modules"]
    pad = next(one for one in modules if one["name"] == "fmfts.pipeline._pad")
    steps = [
        Path(fmfts.__file__).parents[1] / Path(name).relative_to("daemon")
        for name in (*pad["sources"], *(path.relative_to(ROOT) for path in headers(pad)))
        if not Path(name).name.startswith("_") and Path(name).name not in ("aligned.h", "stable_abi.h")
    ]
    assert len(steps) > 50
    for step in steps:
        code = step.read_text()
        assert not ALLOCATES.search(code), step
