"""A recording may claim any memory: it is refused, or frames go on from it, and nothing is read or written elsewhere.

`make sanitize` runs this, too.
"""

from __future__ import annotations

from itertools import islice
from typing import Any

import msgspec
import numpy as np
import pytest

from fmfts.common.memory import encode
from fmfts.pipeline.pad_pipeline import PadPipeline, PipelineMemory
from fmfts.pipeline.snapshot import FORMAT, BadMemoryError, Snapshot, restore
from golden.replayed import pipelines_of
from golden.world import load

WHOLE = (0, -1, 1, 5, 9, 63, 64, 2**31, 2**53, -(2**53), 2**60, -(2**60), 2**62, -(2**63), 2**63 - 1)
NUMBERS = (0.0, -1.0, 1e300, -1e300, np.nan, np.inf, -np.inf, 1e19, 1e-300)
# So many frames of a world: with a count that no chip has, with a fault that was found, and with none.
AMID = {"growing": 2310, "faulty": 290, "healthy": 200}
OUTSIDE: dict[str, Any] = {
    "found_sensor": (4, -2, 1 << 40), "heard": (16, -1), "suspects": (1 << 62, -(1 << 63)), "searched_sensors": (16,),
    "searched": (5, -1), "explained": (1 << 12,), "time_us": (1 << 51, -(1 << 63)), "number": (2**63 - 1,),
    "stood_ns": (-(1 << 63),), "repeats": (2**63 - 1,),
}  # fmt: skip


def claimed(memory: PipelineMemory) -> bytes:
    """A snapshot, as anybody may write it into a recording."""
    return msgspec.msgpack.encode(Snapshot(FORMAT, msgspec.Raw(encode(memory))))


def with_number(memory: PipelineMemory, name: str, place: int, number: Any) -> PipelineMemory:
    changed = np.array(memory.fields[name], ndmin=1)
    changed[place % len(changed)] = number
    return PipelineMemory(
        **{key: getattr(memory, key) for key in PipelineMemory.__dataclass_fields__}
        | {"fields": memory.fields | {name: changed.reshape(memory.fields[name].shape)}}
    )


@pytest.mark.parametrize("world", AMID)
def test_odd_memory_is_refused_or_frames_go_on_from_it(world: str) -> None:
    random, refused = np.random.default_rng(1), 0
    (pad,) = load(world)[0].pads
    with pipelines_of(load(world)[0]) as pipelines:
        (pipeline,) = pipelines.values()
        assert isinstance(pipeline, PadPipeline)
        frames: list[Any] = [events[0] for _, events in islice(pad.events(), AMID[world] + 3)]
        for frame in frames[:-3]:
            pipeline.answer(frame)
        memory = pipeline.memory
        for number in range(4 * len(memory.fields)):
            name = [*memory.fields][number % len(memory.fields)]
            odd = random.choice(WHOLE if memory.fields[name].dtype.kind == "i" else NUMBERS)  # type: ignore[arg-type]
            try:
                restore(pipeline, claimed(with_number(memory, name, int(random.integers(1000)), odd)))
            except BadMemoryError:
                refused += 1
            for frame in frames[-3:]:
                try:
                    pipeline.answer(frame)
                except ArithmeticError:
                    break
    assert 20 < refused < len(memory.fields) * 3


@pytest.mark.parametrize("name", OUTSIDE)
def test_number_that_no_pad_remembers_is_refused(name: str) -> None:
    with pipelines_of(load("bare")[0]) as pipelines:
        (pipeline,) = pipelines.values()
        assert isinstance(pipeline, PadPipeline)
        memory = pipeline.memory
        for number in OUTSIDE[name]:
            with pytest.raises(BadMemoryError, match=r" is no "):
                restore(pipeline, claimed(with_number(memory, name, 0, number)))
        assert pipeline.memory.fields[name].tolist() == memory.fields[name].tolist()
