"""A recording may claim any memory: it is refused, or frames go on from it, and nothing is read or written elsewhere.

`make sanitize` runs this, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from fmfts.baseline import Baseline
from fmfts.baseline.posture import StoredPosture
from fmfts.baseline.posture_fit import fit_posture
from fmfts.bus.messages import SlipMessage
from fmfts.common.memory import encode
from fmfts.pipeline.first_memory import OF_SLIP
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.possible_memory import BLAMED
from fmfts.pipeline.remembering import PadMemory
from fmfts.pipeline.snapshot import FORMAT, BadMemoryError, Snapshot, restore
from fmfts.sensor import Frame
from golden.replayed import pipelines_of
from golden.world import World, load

WHOLE = (0, -1, 1, 5, 9, 63, 64, 2**31, 2**53, -(2**53), 2**60, -(2**60), 2**62, -(2**63), 2**63 - 1)
NUMBERS = (0.0, -1.0, 1e300, -1e300, np.nan, np.inf, -np.inf, 1e19, 1e-300)
# This many frames of a world: with a count that no chip gives, with a fault that was found, and with none.
AMID = {"growing": 2310, "faulty": 290, "healthy": 200, "slip": 200, "posture": 200}
ASKED = {"slip": "sheared", "posture": "healthy"}  # memories of these worlds, with another configuration
AFTER = 3  # frames
OUTSIDE: dict[str, Any] = {
    "found_sensor": (4, -2, 1 << 40), "heard": (16, -1), "suspects": (1 << 62, -(1 << 63)), "searched_sensors": (16,),
    "searched": (6, -1), "explained": (1 << 12,), "time_us": (1 << 51, -(1 << 63)), "number": (2**63 - 1,),
    "stood_ns": (-(1 << 63),), "repeats": (2**63 - 1,), "blamed": (41, -1, 1 << 61),
    "native_frames": (45, -1, 1 << 60),
}  # fmt: skip
ALTERNATING = Path(__file__).parents[2] / "daemon/fmfts/pose/alternating.c"


@contextmanager
def amid(name: str) -> Iterator[tuple[PadPipeline, list[Frame]]]:
    """A pipeline in the middle of a world, and its next frames."""
    (pad,), count = load(ASKED.get(name, name))[0].pads, AMID[name]
    if name == "slip":
        pad = replace(pad, config=pad.config | {"contact": {"model": "shear", "slip": True}})
    if name == "posture":
        baseline = msgspec.to_builtins(on_a_hand(msgspec.convert(pad.baseline, Baseline)))
        pad = replace(pad, config=pad.config | {"scene": {"ambient": "posture"}}, baseline=baseline)
    with pipelines_of(World(name, [pad])) as pipelines:
        (pipeline,) = pipelines.values()
        assert isinstance(pipeline, PadPipeline)
        frames: list[Any] = [events[0] for _, events in islice(pad.events(), count + AFTER)]
        for frame in frames[:-AFTER]:
            if pipeline.hand is not None:
                pipeline.hand.take({"knuckle": 0.3, "tip": 0.1}, frame.host_time_ns)
            told = pipeline.process(frame)
        assert (told.slip is not msgspec.UNSET) == (name == "slip")
        assert name != "slip" or told.slip.slipping is not None
        assert (pipeline.hand is not None) == (name == "posture")
        yield pipeline, frames[-AFTER:]


def on_a_hand(baseline: Baseline) -> Baseline:
    """Two joints move the field by some microtesla."""
    random = np.random.default_rng(2)
    joints, values = random.uniform(-1.0, 1.0, (200, 2)), 3 * load("healthy")[0].pads[0].stream.counts.shape[1]
    change = 1e-6 * joints @ random.normal(size=(2, values)) + 1e-8 * random.normal(size=(200, values))
    taught = fit_posture(("knuckle", "tip"), joints, change, np.tile(np.eye(3), (values // 3, 1)))
    return msgspec.structs.replace(baseline, posture=StoredPosture.of(taught)).sealed()


def claimed(memory: PadMemory) -> bytes:
    """A snapshot, as anybody may write it into a recording."""
    return msgspec.msgpack.encode(Snapshot(FORMAT, msgspec.Raw(encode(memory))))


def with_number(memory: PadMemory, name: str, place: int, number: Any) -> PadMemory:
    changed = np.array(memory.fields[name], ndmin=1)
    changed[place % len(changed)] = number
    return PadMemory(
        **{key: getattr(memory, key) for key in PadMemory.__dataclass_fields__}
        | {"fields": memory.fields | {name: changed.reshape(memory.fields[name].shape)}}
    )


@pytest.mark.parametrize("world", AMID)
def test_odd_memory_is_refused_or_frames_go_on_from_it(world: str) -> None:
    random, refused = np.random.default_rng(1), 0
    with amid(world) as (pipeline, frames):
        memory = pipeline.memory
        for number in range(4 * len(memory.fields)):
            name = [*memory.fields][number % len(memory.fields)]
            odd = random.choice(WHOLE if memory.fields[name].dtype.kind == "i" else NUMBERS)  # type: ignore[arg-type]
            try:
                restore(pipeline, claimed(with_number(memory, name, int(random.integers(1000)), odd)))
            except BadMemoryError:
                refused += 1
            for frame in frames:
                try:
                    pipeline.answer(frame)
                except ArithmeticError:
                    break
    assert 20 < refused < len(memory.fields) * 3


def test_odd_slip_memory_gives_only_finite_numbers() -> None:
    """Of a finger that sticks and of one that slips; after an error of the frame it goes on, as a daemon has it."""
    random, errors = np.random.default_rng(3), 0
    with amid("slip") as (pipeline, frames):
        memory = pipeline.memory
        for number in range(60 * len(OF_SLIP)):
            name = OF_SLIP[number % len(OF_SLIP)]
            slips = with_number(memory, "slipping", 0, float(random.integers(2)))
            odd = random.choice(NUMBERS)
            restore(pipeline, claimed(with_number(slips, name, int(random.integers(1000)), odd)))
            for frame in frames:
                try:
                    told = pipeline.process(frame)
                except ArithmeticError:
                    errors += 1
                    pipeline.start_anew()
                else:
                    assert isinstance(told.slip, SlipMessage)
                    numbers = msgspec.structs.astuple(told.slip)
                    assert np.isfinite([one for one in numbers if one is not None]).all(), (name, odd)
    assert 0 < errors < 60 * len(OF_SLIP)


@pytest.mark.parametrize("name", OUTSIDE)
def test_impossible_memory_number_is_refused(name: str) -> None:
    with pipelines_of(load("bare")[0]) as pipelines:
        (pipeline,) = pipelines.values()
        assert isinstance(pipeline, PadPipeline)
        memory = pipeline.memory
        for number in OUTSIDE[name]:
            with pytest.raises(BadMemoryError, match=r" is no "):
                restore(pipeline, claimed(with_number(memory, name, 0, number)))
        assert pipeline.memory.fields[name].tolist() == memory.fields[name].tolist()


def test_largest_number_of_frames_that_remember_a_blamed_sensor_is_that_of_the_code() -> None:
    (frames,) = re.findall(r"\bBLAMED_FRAMES = (\d+)", ALTERNATING.read_text())
    assert int(frames) == BLAMED.highest
