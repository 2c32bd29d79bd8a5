"""Pads that feel each other, in C: the same messages as by the stages in Python, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fast_loop_host import Bus, Host, sample_of
from test_fast_loop import at_no_time
from test_link import hello

from fmfts.baseline import Baseline
from fmfts.config import PadConfig, neighbours_of
from fmfts.pipeline.configured import contact_model_of, feel_neighbours, pipeline_of
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.sensor import Frame
from fmfts.sensor.wire.framing import encode
from fmfts_lab.bench.drills import FRAME_NS, RATE_HZ
from fmfts_lab.bench.neighbours import pair, source_of
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch


def taps(later_s: float) -> Finger:
    """Presses of 0.4 s, with pauses of as long."""

    def finger(time_s: float) -> Touch:
        number, within_s = divmod(time_s - later_s, 0.8)
        return (
            Touch(2e-3, -1e-3, 0.3 + 0.5 * (number % 4)) if within_s > 0.4 and number >= 0.0 else Touch(0.0, 0.0, 0.0)
        )

    return finger


def frames_of(pads: tuple[PadConfig, PadConfig], seconds: float) -> Iterator[tuple[str, Frame]]:
    fingers = {pads[0].name: taps(0.0), pads[1].name: taps(0.3)}
    sources = {pad.name: source_of(pad, pads, fingers) for pad in pads}
    for step in range(round(seconds * RATE_HZ)):
        for name, source in sources.items():
            for frame in source.poll(step * FRAME_NS):
                yield name, frame


def pipelines_of(pads: tuple[PadConfig, PadConfig], baselines: dict[str, Baseline]) -> dict[str, PadPipeline]:
    pipelines: dict[str, Any] = {pad.name: pipeline_of(pad, contact_model_of(pad), "boot") for pad in pads}
    for pad in pads:
        pipelines[pad.name].use(baselines[pad.name])
        feel_neighbours(pad, pads, pipelines)
    return pipelines


def test_fast_loop_agrees_for_pads_on_two_boards() -> None:
    """From the bytes of both boards to the bus in C, and by way of frames: equal to the last bit."""
    pads = pair(30.0, "drifting", seed=4)
    baselines = {pad.name: simulated_baseline(pad, neighbours_of(pad, pads)) for pad in pads}
    frames, told = list(frames_of(pads, 1.5)), {}
    for may_express in (True, False):
        bus = Bus()
        hosts = {
            pad.name: Host(pad, baselines[pad.name], bus, may_express, line)
            for line, pad in zip((3, 4), pads, strict=True)
        }
        pipelines: dict[str, Any] = {name: host.pipeline for name, host in hosts.items()}
        for pad in pads:
            feel_neighbours(pad, pads, pipelines)
            hosts[pad.name].take(encode(hello(4)), 0)
        for name, frame in frames:
            hosts[name].take(encode(sample_of(frame)), 10**9 + 1000 * frame.device_time_us)
        for host in hosts.values():
            if host.lent is not None:
                host.end()
        told[may_express] = hosts
        bus.close()
    for pad in pads:
        by_express, by_frames = (told[may_express][pad.name].told for may_express in (True, False))
        assert at_no_time(by_express.messages) == at_no_time(by_frames.messages)
        assert by_express.expressed > 0.85 * len(by_frames.messages)
        assert by_frames.expressed == 0
