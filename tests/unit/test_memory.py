"""A pipeline that is restored in the middle of whatever happens goes on bit for bit."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fmfts.bus.messages import ContactMessage
from fmfts.config import GeometryConfig, PadConfig, SceneConfig, SimulatedSource
from fmfts.contact import ContactModel
from fmfts.offline.replay import essence
from fmfts.pipeline.fast import _fast
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pipeline.snapshot import BadMemoryError, restore, snapshot
from fmfts.pose import State
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor import Frame
from fmfts.simulation.baseline import simulated_baseline
from fmfts.simulation.finger import UNLOADED_AT_START_S
from fmfts.simulation.source import Simulated

DRIFTING = PadConfig(name="left", source=SimulatedSource(seed=3, warming_k_per_minute=30.0))
CONSTANT = PadConfig(name="left", source=SimulatedSource(turning_deg_per_s=0.0), scene=SceneConfig(ambient="constant"))
# The scripted finger begins to touch after 4 s, which are not worth the time.
SKIPPED_S = UNLOADED_AT_START_S - 0.3
COUNT = 640
# Each snapshot has the next frame judged in Python: up to the next one, both go the same way.
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
    """By a field that was called constant, 20 mG over all sensors."""
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


def test_snapshot_changes_nothing_but_last_digits() -> None:
    """Of them, because the frame after it is judged in Python."""
    given = frames(DRIFTING, healthy)[:300]
    watched, alone = pipeline(DRIFTING), pipeline(DRIFTING)
    baseline = simulated_baseline(DRIFTING)
    watched.use(baseline)
    alone.use(baseline)
    for frame in given:
        assert snapshot(watched) == snapshot(watched)
        one, other = watched.process(frame), alone.process(frame)
        assert (one.health, one.contact, one.seq) == (other.health, other.contact, other.seq)
        assert one.force_n == pytest.approx(other.force_n, rel=1e-6, abs=1e-9)


def test_memory_tells_where_the_pipeline_stands() -> None:
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


def test_memory_of_format_1_is_read() -> None:
    """What the version before wrote: 1.5 s into a lying sensor, and one second into a session of a turning robot."""
    given = msgspec.msgpack.decode((Path(__file__).parents[1] / "data/memories_v1.msgpack").read_bytes())
    lying, turning = pipeline(DRIFTING), pipeline(CONSTANT)
    lying.use(simulated_baseline(DRIFTING))
    turning.use(simulated_baseline(CONSTANT))
    restore(lying, given["a sensor that lies"])
    restore(turning, given["a turned robot"])
    memory = lying.memory
    assert memory.number == 330
    assert memory.estimator is not None
    assert memory.estimator.tracker.watch is not None
    finding = memory.estimator.tracker.watch.finding
    assert finding is not None
    assert finding.sensor == 1
    assert memory.estimator.tracker.watch.residuals.pushed == 55
    next_frame = frames(DRIFTING, sensor_that_lies)[330]
    assert lying.process(next_frame).health == "degraded"
    memory = turning.memory
    assert memory.estimator is not None
    assert memory.estimator.ambient_motion is not None
    assert memory.estimator.ambient_motion.frames_seen == 230
    assert 0 < len(memory.estimator.ambient_motion.explained) <= 12
    assert memory.estimator.tracker.disturbed_frames > 0


def test_memory_of_a_later_format_is_refused_with_what_to_do() -> None:
    later = msgspec.msgpack.encode({"format": 3, "memory": {}})
    with pytest.raises(BadMemoryError, match=r"format 3, .*update fmfts"):
        restore(pipeline(DRIFTING), later)


def test_every_memory_of_the_compiled_path_is_declared_once() -> None:
    """Others count since the hand-over, or say for which frames it is, and are of C alone."""
    of_c = {"passed", "was_sound", "silent", "saturated", "gain_code", "blamed", "most"}
    first = pipeline(CONSTANT)
    first.use(simulated_baseline(CONSTANT))
    declared = list(names(first.memory))
    for name in set(_fast.MEMORY) - of_c:
        assert declared.count(name) == 1, name


def names(memory: object) -> Iterator[str]:
    for each in dataclasses.fields(memory):  # type: ignore[arg-type]
        value = getattr(memory, each.name)
        yield each.name
        if dataclasses.is_dataclass(value) and not isinstance(value, State):
            yield from names(value)


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
    with pytest.raises(BadMemoryError, match=r"alignment.field_t has the shape \(3, 3, 3\), not \(3, 4, 3\)"):
        restore(before, content)
    assert snapshot(before) == was


def test_memory_of_a_pad_with_a_baseline_is_refused_by_one_without() -> None:
    with_baseline = pipeline(DRIFTING)
    with_baseline.use(simulated_baseline(DRIFTING))
    with pytest.raises(BadMemoryError):
        restore(pipeline(DRIFTING), snapshot(with_baseline))
