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
from fmfts.sensor.source import SourceState
from fmfts.sensor.wire.clock import DeviceClock
from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.link import Link
from fmfts.sources import on_board
from fmfts_client.endpoints import for_daemon
from fmfts_lab.bench import frame_beside, frame_states
from fmfts_lab.bench import latency_rig as rig
from fmfts_lab.bench.frame_whole import PERIOD_NS, Whole, pipeline_of
from fmfts_lab.bench.latency import pad_of

OTHER_BYTES = 48_000_000  # more than the last cache holds
SETTLED = 300  # this many frames at the beginning are not measured
HOT_FRAMES, COLD_FRAMES = 1500, 300


def run(options: argparse.Namespace) -> None:
    """Print the medians: on a busy computer some frames are interrupted."""
    if options.beside is not None:
        frame_beside.run(options.beside)
        return
    if options.first:
        frame_states.run_first(options.first)
        return
    if options.states:
        frame_states.run()
        return
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
    link = Link({0: on_board(config)}, SourceState("bench"), DeviceClock())
    topic = contact_topic(config.name)
    pipeline, whole = pipeline_of(config), Whole(config, publisher)
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
            answer = timed("judge, contact model, message", pipeline.answer, frame)
            timed("send (two parts)", publisher.send_encoded, topic, answer.payload)
            timed("the contact model alone: compiled", model.inference.run)
    # Not together with the rows above: this would push their data out of the caches.
    for _ in lines:
        timed("the contact model alone: onnxruntime", session.run)
    return {name: values[SETTLED:] for name, values in found.items()}
