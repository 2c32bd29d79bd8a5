"""One memory for pads with one magnet and with several: a pipeline takes that of another kind of pad for none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_now_of_several import CONFIG, frames, ready
from test_poses_pipeline import ready as without_table

from fmfts.common.memory import encode
from fmfts.config import PadConfig, SimulatedSource
from fmfts.pipeline.configured import Pipeline, contact_model_of, pipeline_of
from fmfts.pipeline.remembering import PadMemory
from fmfts.pipeline.snapshot import BadMemoryError, restore, snapshot
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import steady_finger


def one_magnet() -> Pipeline:
    config = PadConfig(name=CONFIG.name, source=SimulatedSource())
    made = pipeline_of(config, contact_model_of(config), "boot")
    made.use(simulated_baseline(config))
    return made


KINDS = {"one": one_magnet, "fingers": ready, "poses": lambda: without_table("2 over 8")}
PARTS = {"one": set[str](), "fingers": {"fingers", "followed"}, "poses": {"poses"}}


@pytest.mark.parametrize("kind", KINDS)
def test_memory_has_only_the_parts_of_its_kind_of_pad(kind: str) -> None:
    memory = KINDS[kind]().memory
    assert {part for part in ("fingers", "poses", "followed") if getattr(memory, part) is not None} == PARTS[kind]


@pytest.mark.parametrize(("of", "by"), [(of, by) for of in KINDS for by in KINDS if of != by])
def test_memory_of_another_kind_of_pad_is_refused(of: str, by: str) -> None:
    with pytest.raises(BadMemoryError):
        restore(KINDS[by](), snapshot(KINDS[of]()))


@pytest.mark.parametrize(("kind", "part"), [("fingers", "fingers"), ("poses", "poses")])
def test_pad_of_several_magnets_that_starts_anew_remembers_no_frame(kind: str, part: str) -> None:
    """But for the ids of its fingers, which nobody may give twice."""
    made = KINDS[kind]()
    before = encode(getattr(made.memory, part))
    for frame in frames(20, steady_finger(-6e-3, -1e-3, 0.8)):
        made.process(frame)
    assert encode(getattr(made.memory, part)) != before
    made.start_anew()
    after = made.memory
    if after.fingers is not None:
        assert after.fingers.counter.next_id == 2
        after.fingers.counter.next_id = 1
    assert encode(getattr(after, part)) == before


@pytest.mark.parametrize("part", ["fields", "followed", "sighting", "fingers"])
def test_refused_memory_changes_nothing(part: str) -> None:
    """Whichever part is impossible, all others are as before."""
    first, other = ready(), ready()
    for frame in frames(20, steady_finger(-6e-3, -1e-3, 0.8)):
        first.process(frame)
    memory, before = first.memory, encode(other.memory)
    with pytest.raises(ValueError, match=r" is no |has the shape"):
        other.recall(damaged(memory, part))
    assert encode(other.memory) == before
    other.recall(memory)
    assert encode(other.memory) == encode(memory)


def damaged(memory: PadMemory, part: str) -> PadMemory:
    if part == "sighting":
        return replace(memory, sighting=replace(memory.sighting, values=np.zeros((3, 7))))
    if part == "fingers":
        assert memory.fingers is not None
        return replace(memory, fingers=replace(memory.fingers, ambient_t=np.zeros(4)))
    name = "found_sensor" if part == "fields" else "taken_us"
    values = getattr(memory, part)
    return replace(memory, **{part: values | {name: np.full_like(values[name], 2**62)}})
