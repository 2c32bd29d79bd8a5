"""Time of one frame by stage: hot (in a loop), and cold (other data is read before each stage).

A running pad is nearer to cold: between frames, 4.5 ms apart, other programs fill the caches.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from fmfts.bus.publisher import Publisher, contact_topic
from fmfts.config import BridgeSource, PadConfig
from fmfts.contact import ContactModel
from fmfts.contact.session import SessionInference
from fmfts.contact.shipped import DEFAULT_PATH
from fmfts.contact.verified import read
from fmfts.pipeline.configured import load_contact_model
from fmfts.pipeline.contact_message import PackedMessage
from fmfts.pipeline.fast import Lane
from fmfts.pipeline.fast.compiled import _fast
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.runtime.fast_loop import send_function
from fmfts.scene.tracking import tracking_model_for
from fmfts.sensor.patience import BEHIND, IN_TIME
from fmfts.sensor.source import SourceState
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.link import Link
from fmfts.simulation.baseline import simulated_baseline
from fmfts.sources import on_board
from fmfts_client.endpoints import for_daemon
from fmfts_lab.bench import latency_rig as rig
from fmfts_lab.bench.latency import pad_of

OTHER_BYTES = 48_000_000  # more than the last cache holds
SETTLED = 300  # so many frames at the beginning are not measured
HOT_FRAMES, COLD_FRAMES = 1500, 300
NEVER_NS = 1 << 62  # the frames' times are not this computer's, so that none is overdue
PERIOD_NS = round(1e9 / rig.RATE_HZ)


def run(options: argparse.Namespace) -> None:
    """Print the medians: on a busy computer some frames are interrupted."""
    del options
    simulated, other = pad_of(0), np.zeros(OTHER_BYTES // 8)
    config = msgspec.structs.replace(simulated, source=BridgeSource(port="bench"))
    lines = [encode(sample) for sample in rig.samples(simulated, (SETTLED + HOT_FRAMES) / rig.RATE_HZ)]
    with tempfile.TemporaryDirectory(prefix="fmfts-frame-") as folder:
        publisher = Publisher(for_daemon(f"ipc://{folder}"), "bench")
        hot = costs(config, publisher, lines, lambda: None)
        cold = costs(config, publisher, lines[: SETTLED + COLD_FRAMES], lambda: other.sum())
        publisher.close()
    print(f"{'median in µs':45} {'hot':>7} {'cold':>7}")
    for name, values in hot.items():
        print(f"{name:45} {np.median(values) / 1e3:7.1f} {np.median(cold[name]) / 1e3:7.1f}")


def costs(
    config: PadConfig, publisher: Publisher, lines: list[bytes], before: Callable[[], object]
) -> dict[str, list[int]]:
    """Nanoseconds of each frame after the first SETTLED; `before` is called before each stage."""
    found: dict[str, list[int]] = {}
    link, reference_link = (Link({0: on_board(config)}, SourceState("bench"), DeviceClock()) for _ in range(2))
    topic = contact_topic(config.name)
    compiled, in_python, whole = pipeline_of(config), pipeline_of(config), Whole(config, publisher)
    model = ContactModel.load("default", config.pad())
    session = SessionInference(read(DEFAULT_PATH))

    def timed(name: str, work: Callable[..., Any], *arguments: object) -> Any:
        before()
        begun = time.perf_counter_ns()
        result = work(*arguments)
        found.setdefault(name, []).append(time.perf_counter_ns() - begun)
        return result

    for number, line in enumerate(lines):
        if not timed("from bytes to bus in one call", whole.take, line, number * PERIOD_NS):
            whole.take_in_python(line, number * PERIOD_NS)
        for frame in timed("unpack, board's clock, frame", link.feed, line, number * PERIOD_NS):
            answer = timed("judge, contact model, message", compiled.answer, frame)
            if isinstance(answer, PackedMessage):
                timed("send (two parts)", publisher.send_packed, topic, answer.payload)
            timed("the contact model alone: compiled", model.inference.run)
    # Apart from the rows above: what they have in the caches is what this would push out.
    for number, line in enumerate(lines):
        for frame in reference_link.feed(line, number * PERIOD_NS):
            timed("the contact model alone: onnxruntime", session.run)
            in_python.hand_back()
            timed("judge and contact by the stages in Python", in_python._judge, frame)
    return {name: values[SETTLED:] for name, values in found.items()}


class Whole:
    """A pad whose frames go from their bytes to the bus in one call, as in the daemon's fast path."""

    LINE = 0  # stands for a descriptor; nothing reads it

    def __init__(self, config: PadConfig, publisher: Publisher) -> None:
        self._clock, self._topic = DeviceClock(), contact_topic(config.name)
        self._link = Link({0: on_board(config)}, SourceState("bench"), self._clock)
        self._pipeline = pipeline_of(config)
        send = send_function()
        assert send is not None
        self._loop = _fast.Loop(-1, send, publisher.address, IN_TIME, BEHIND)
        self._lane: Lane | None = None

    def take(self, line: bytes, arrival_ns: int) -> bool:
        return self._lane is not None and self._loop.take(self.LINE, line, arrival_ns)

    def take_in_python(self, line: bytes, arrival_ns: int) -> None:
        """Process in Python a line that C did not take; C may take the next ones."""
        if self._lane is not None:
            self._loop.end(self.LINE)
            self._pipeline.end(self._lane)
        for frame in self._link.feed(line, arrival_ns):
            self._pipeline.answer(frame)
        self._lane = self._pipeline.begin(self._clock.line, self._topic, 0, NEVER_NS)
        if self._lane is not None:
            self._loop.begin(self.LINE, b"", (self._lane.compiled,))


def pipeline_of(config: PadConfig) -> PadPipeline:
    """The pad's pipeline, with its simulated baseline in use."""
    pad, scene = config.pad(), tracking_model_for(config.scene, config.magnet)
    pipeline = PadPipeline(pad, load_contact_model(config), "bench", float(rig.RATE_HZ), scene.tracking)
    pipeline.use(simulated_baseline(pad_of(0)))
    return pipeline
