"""The cost of a frame by the state of its pad: healthy, without a sensor, disturbed, with another model, recorded.

From the bytes on the line to the bus, as the daemon does it: without Python as long as its loop takes the frames. The
processor time of the thread is counted, so that other programs do not matter; ZeroMQ's own thread is not in it.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from fmfts.bus.publisher import Publisher
from fmfts.config import BridgeSource, ContactConfig, PadConfig, PlacementConfig, SceneConfig, SimulatedSource
from fmfts.pipeline.configured import contact_model_of, feel_neighbours, pipeline_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.runtime.recorders import Recorders
from fmfts.sensor.chips import DEFAULT_CHIP
from fmfts.sensor.source import SourceState
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.link import Link
from fmfts.sensor.wire.packets import Sample
from fmfts.sources import on_board
from fmfts_client.endpoints import for_daemon
from fmfts_lab.bench import latency_rig as rig
from fmfts_lab.bench.frame_whole import PERIOD_NS, Whole
from fmfts_lab.bench.latency import pad_of
from fmfts_lab.bench.overload_rig import beside_steel, random_finger
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, no_finger, steady_finger
from fmfts_simulation.source import Simulated

SETTLED, FRAMES = 440, 880  # not measured, and measured
AFTER_FAULT = 11  # frames
OFFSET_COUNTS = 150  # 23 µT
PRESS = steady_finger(2e-3, 1e-3, 0.8)
RATE_HZ = 220
Spoil = Callable[[Sample, int], Sample]


@dataclass(frozen=True)
class State:
    """spoil: what is wrong with the samples, by their number. contact: the pad's contact section. recorded: somebody
    records. beside: another pad is near, and its field is measured.
    """

    name: str
    finger: Finger = no_finger
    spoil: Spoil | None = None
    contact: ContactConfig = ContactConfig()  # noqa: RUF009
    recorded: bool = False
    beside: bool = False


def _silent(sample: Sample, number: int) -> Sample:
    return replace(sample, valid=sample.valid & ~2, fresh=sample.fresh & ~2)


def _two_silent(sample: Sample, number: int) -> Sample:
    return replace(sample, valid=sample.valid & ~3, fresh=sample.fresh & ~3)


def _with_counts(sample: Sample, change: Callable[[Any], None]) -> Sample:
    counts = sample.counts.copy()
    change(counts)
    return replace(sample, counts=counts)


def _saturated(sample: Sample, number: int) -> Sample:
    def spoil(counts: Any) -> None:
        counts[3, 2] = DEFAULT_CHIP.saturated_count

    return _with_counts(sample, spoil)


def _off(sample: Sample, number: int) -> Sample:
    """After two seconds without a fault: later the sensor is known for it, and left out."""

    def spoil(counts: Any) -> None:
        counts[1, 0] += OFFSET_COUNTS if number > SETTLED // 2 else 0

    return _with_counts(sample, spoil)


def _steel(sample: Sample, number: int) -> Sample:
    return beside_steel(sample) if number > SETTLED // 2 else sample


STATES = (
    State("healthy"),
    State("touched", PRESS),
    State("touched and released at random", random_finger(1)),
    State("one sensor silent", PRESS, _silent),
    State("one axis saturated", PRESS, _saturated),
    State("one sensor at odds, left out", PRESS, _off),
    State("disturbed", PRESS, _steel),
    State("lost: two sensors silent", PRESS, _two_silent),
    State("no contact model", PRESS, contact=ContactConfig(model="none")),
    State("shear model", PRESS, contact=ContactConfig(model="shear")),
    State("smoothing of 20 ms", PRESS, contact=ContactConfig(smoothing_ms=20.0)),
    State("a neighbour that is felt", PRESS, beside=True),
    State("a recorder", PRESS, recorded=True),
)


def run() -> None:
    print("| state | median µs | mean µs | without Python, % | of a core at 220 Hz, % |")
    print("| --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory(prefix="fmfts-states-") as folder:
        publisher = Publisher(for_daemon(f"ipc://{folder}"), "bench")
        for state in STATES:
            costs_ns, taken = measured(state, publisher)
            median, mean = np.median(costs_ns) * 1e-3, np.mean(costs_ns) * 1e-3
            share = 100.0 * RATE_HZ * mean * 1e-6
            print(f"| {state.name} | {median:.0f} | {mean:.0f} | {100 * taken:.0f} | {share:.1f} |", flush=True)
        publisher.close()


def run_first(repeats: int) -> None:
    """The first frame after a fault that a pad did not have before, of fresh pads."""
    print("| fault | first frame, median µs | largest | next ten, median of the largest |\n| --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory(prefix="fmfts-states-") as folder:
        publisher = Publisher(for_daemon(f"ipc://{folder}"), "bench")
        for state in STATES:
            if state.spoil is None:
                continue
            costs_us = np.array([_after_fault(state, state.spoil, publisher) for _ in range(repeats)]) * 1e-3
            first, later = costs_us[:, 0], costs_us[:, 1:].max(axis=1)
            print(f"| {state.name} | {np.median(first):.0f} | {first.max():.0f} | {np.median(later):.0f} |", flush=True)
        publisher.close()


def _after_fault(state: State, spoil: Spoil, publisher: Publisher) -> list[int]:
    """Nanoseconds of the frames after a fault began."""
    source = Simulated(pad_of(0))
    source.finger = state.finger
    samples = rig.samples_of(source, (SETTLED + AFTER_FAULT) / RATE_HZ)
    whole, costs_ns = Whole(msgspec.structs.replace(pad_of(0), source=BridgeSource(port="bench")), publisher), []
    for number, sample in enumerate(samples):
        line = encode(spoil(sample, number) if number >= SETTLED else sample)
        begun = time.thread_time_ns()
        if not whole.take(line, number * PERIOD_NS):
            whole.take_in_python(line, number * PERIOD_NS)
        costs_ns.append(time.thread_time_ns() - begun)
    return costs_ns[SETTLED:]


def measured(state: State, publisher: Publisher) -> tuple[list[int], float]:
    """Nanoseconds of each frame, and the share of the frames that the loop took."""
    simulated = msgspec.structs.replace(pad_of(0), contact=state.contact)
    source = Simulated(simulated)
    source.finger = state.finger
    samples = rig.samples_of(source, (SETTLED + FRAMES) / RATE_HZ)
    spoilt = [sample if state.spoil is None else state.spoil(sample, at) for at, sample in enumerate(samples)]
    lines = [encode(sample) for sample in spoilt]
    config = msgspec.structs.replace(simulated, source=BridgeSource(port="bench"))
    pipeline = _beside_another(config) if state.beside else _alone(config)
    if state.recorded:
        return _recorded(config, pipeline, lines, publisher), 0.0
    whole, costs_ns, in_c = Whole(config, publisher, pipeline), [], 0
    for number, line in enumerate(lines):
        begun = time.thread_time_ns()
        taken = whole.take(line, number * PERIOD_NS)
        if not taken:
            whole.take_in_python(line, number * PERIOD_NS)
        costs_ns.append(time.thread_time_ns() - begun)
        in_c += taken and number >= SETTLED
    return costs_ns[SETTLED:], in_c / FRAMES


def _recorded(config: PadConfig, pipeline: PadPipeline, lines: list[bytes], publisher: Publisher) -> list[int]:
    """Nanoseconds of each frame while somebody records: Python must see them."""
    link = Link({0: on_board(config)}, SourceState("bench"), DeviceClock())
    recorders, costs_ns = Recorders(pipeline, publisher, "bench"), []
    for number, line in enumerate(lines):
        begun = time.thread_time_ns()
        for frame in link.feed(line, number * PERIOD_NS):
            recorders.frame(frame, used=True)
            publisher.send_encoded(b"contact/p0", pipeline.answer(frame).payload)
        costs_ns.append(time.thread_time_ns() - begun)
    return costs_ns[SETTLED:]


def _alone(config: PadConfig) -> PadPipeline:
    pipeline = pipeline_of(config, contact_model_of(config), "bench")
    assert isinstance(pipeline, PadPipeline)
    pipeline.use(simulated_baseline(pad_of(0)))
    return pipeline


def _beside_another(config: PadConfig) -> PadPipeline:
    """A pad whose neighbour, 40 mm beside it, rests."""
    felt = msgspec.structs.replace(config, scene=SceneConfig(neighbours=("p1",)))
    other = msgspec.structs.replace(
        pad_of(1),
        source=SimulatedSource(seed=2),
        placement=PlacementConfig(position_mm=(40.0, 0.0, 0.0)),
        scene=SceneConfig(neighbours=("p0",)),
    )
    pipelines: dict[str, Any] = {"p0": _alone(felt), "p1": pipeline_of(other, contact_model_of(other), "bench")}
    feel_neighbours(felt, (felt, other), pipelines)
    pipeline: PadPipeline = pipelines["p0"]
    return pipeline
