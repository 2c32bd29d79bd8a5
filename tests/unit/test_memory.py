"""A pipeline that is restored in the middle of whatever happens goes on bit for bit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from fmfts.bus.messages import ContactMessage
from fmfts.config import GeometryConfig, PadConfig, SceneConfig, SimulatedSource
from fmfts.contact import ContactModel
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.snapshot import BadMemoryError, restore, snapshot
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor import Frame
from fmfts_recording.replay import essence
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import UNLOADED_AT_START_S
from fmfts_simulation.source import Simulated

DRIFTING = PadConfig(name="left", source=SimulatedSource(seed=3, warming_k_per_minute=30.0))
CONSTANT = PadConfig(name="left", source=SimulatedSource(turning_deg_per_s=0.0), scene=SceneConfig(ambient="constant"))
# The scripted finger begins to touch only after 4 s.
SKIPPED_S = UNLOADED_AT_START_S - 0.3
COUNT = 640
EVERY = 90
Fault = Callable[[int, Frame], Frame]


def healthy(number: int, frame: Frame) -> Frame:
    return frame


def sensor_that_lies(number: int, frame: Frame) -> Frame:
    """From 100 frames on, one axis by 60 mG."""
    counts = frame.counts.copy()
    counts[1, 0] += 40 * (number > 100)
    return replace(frame, counts=counts)


def steel(number: int, frame: Frame) -> Frame:
    """Comes and goes."""
    counts = frame.counts.copy()
    counts[0] += 200 * (number // 100 % 2)
    return replace(frame, counts=counts)


def sensor_that_falls_silent(number: int, frame: Frame) -> Frame:
    valid = np.ones(4, dtype=bool)
    valid[2] = number // 70 % 2
    return replace(frame, valid=valid)


def turned(number: int, frame: Frame) -> Frame:
    """Turned by a field that was called constant, 20 mG over all sensors."""
    counts = frame.counts.copy()
    counts += np.int16(14 * (number // 130 % 2))
    return replace(frame, counts=counts)


def pipeline(config: PadConfig) -> PadPipeline:
    pad = config.pad()
    return PadPipeline(
        pad, ContactModel.load("default", pad), "boot", 220.0, tracking_model_for(config.scene, config.magnet).tracking
    )


def frames(config: PadConfig, fault: Fault) -> list[Frame]:
    source = Simulated(config)
    script = source.finger
    source.finger = lambda time_s: script(time_s + SKIPPED_S)
    taken: list[Frame] = []
    while len(taken) < COUNT:
        taken.extend(source.poll(len(taken) * round(1e9 / 220)))
    return [fault(number, frame) for number, frame in enumerate(taken)]


@pytest.mark.parametrize(
    ("config", "fault"),
    [
        (DRIFTING, healthy),
        (DRIFTING, sensor_that_lies),
        (DRIFTING, steel),
        (DRIFTING, sensor_that_falls_silent),
        (CONSTANT, turned),
    ],
)
def test_restored_pipeline_goes_on_bit_for_bit(config: PadConfig, fault: Fault) -> None:
    baseline, given = simulated_baseline(config), frames(config, fault)
    first, said, memories = pipeline(config), list[ContactMessage](), {}
    first.use(baseline)
    for number, frame in enumerate(given):
        if number % EVERY == 37:
            memories[number] = snapshot(first)
        said.append(first.process(frame))
    assert len({(each.health, each.contact) for each in said}) > 1, "nothing happened"
    for number, memory in memories.items():
        later = pipeline(config)
        later.use(baseline)
        restore(later, memory)
        for expected, frame in zip(said[number : number + EVERY], given[number:], strict=False):
            assert essence(later.process(frame)) == essence(expected)


@pytest.mark.parametrize("fault", [healthy, sensor_that_lies, steel])
def test_snapshot_changes_nothing(fault: Fault) -> None:
    given = frames(DRIFTING, fault)[:300]
    watched, alone = pipeline(DRIFTING), pipeline(DRIFTING)
    baseline = simulated_baseline(DRIFTING)
    watched.use(baseline)
    alone.use(baseline)
    for frame in given:
        assert snapshot(watched) == snapshot(watched)
        assert essence(watched.process(frame)) == essence(alone.process(frame))


def test_snapshot_describes_the_pipeline_state() -> None:
    """It would not do to restore nothing: a fresh pipeline says something else."""
    given = frames(DRIFTING, steel)
    old, fresh = pipeline(DRIFTING), pipeline(DRIFTING)
    baseline = simulated_baseline(DRIFTING)
    old.use(baseline)
    fresh.use(baseline)
    for frame in given[:250]:
        old.process(frame)
    assert essence(old.process(given[250])) != essence(fresh.process(given[250]))


@pytest.mark.parametrize("damage", [b"", b"\x00", b"\x80", b"\xc1", b"\x81\xa1x\x01", b"x" * (2 << 20)])
def test_damaged_memory_is_refused(damage: bytes) -> None:
    with pytest.raises(BadMemoryError):
        restore(pipeline(DRIFTING), damage)


@pytest.mark.parametrize("number", [1, 2, 4])
def test_memory_of_another_format_is_refused_with_its_number(number: int) -> None:
    other = msgspec.msgpack.encode({"format": number, "memory": {}})
    with pytest.raises(BadMemoryError, match=f"format {number}, but this version of fmfts reads only 3"):
        restore(pipeline(DRIFTING), other)


def test_memory_with_another_field_is_refused() -> None:
    content = msgspec.msgpack.decode(snapshot(pipeline(DRIFTING)))
    content["memory"]["fields"]["foreign_mt"] = content["memory"]["fields"].pop("foreign_t")
    with pytest.raises(BadMemoryError, match="other fields than this version has"):
        restore(pipeline(DRIFTING), msgspec.msgpack.encode(content))


def test_memory_of_another_number_of_sensors_is_refused_and_changes_nothing() -> None:
    three = msgspec.structs.replace(DRIFTING, geometry=GeometryConfig(sensors_mm=((8, 8, 0), (8, -8, 0), (-8, 8, 0))))
    before, other = (
        pipeline(DRIFTING),
        PadPipeline(
            three.pad(),
            ContactModel.load("default", DRIFTING.pad()),
            "boot",
            220.0,
            tracking_model_for(DRIFTING.scene, DRIFTING.magnet).tracking,
        ),
    )
    content = snapshot(other)
    was = snapshot(before)
    with pytest.raises(BadMemoryError, match="of a pad with 3 sensors, and this one has 4"):
        restore(before, content)
    assert snapshot(before) == was


def test_memory_of_pad_with_baseline_is_refused_by_one_without() -> None:
    with_baseline = pipeline(DRIFTING)
    with_baseline.use(simulated_baseline(DRIFTING))
    with pytest.raises(BadMemoryError, match="of a pad with a baseline"):
        restore(pipeline(DRIFTING), snapshot(with_baseline))
