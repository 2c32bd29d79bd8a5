"""Pads that feel each other, in C: the same messages as by the stages in Python, frame by frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fast_loop_host import Bus, Host, sample_of
from test_fast_loop import at_no_time
from test_healthy_path import assert_same, python_only
from test_link import hello

from fmfts.baseline import Baseline
from fmfts.config import PadConfig, neighbours_of
from fmfts.pipeline.configured import contact_model_of, feel_neighbours, pipeline_of
from fmfts.pipeline.contact_message import PackedMessage
from fmfts.pipeline.fast import Kind, _fast
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.pose.sighting import sighting_layout
from fmfts.sensor import Frame
from fmfts.sensor.wire.framing import encode
from fmfts.simulation.baseline import simulated_baseline
from fmfts.simulation.finger import Finger, Touch
from fmfts_lab.bench.drills import FRAME_NS, RATE_HZ, Ambient
from fmfts_lab.bench.neighbours import pair, source_of


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


def lasting_t2(pipeline: PadPipeline) -> np.ndarray:
    """Of each axis, what the mean residuals take for lasting: curvature, and the neighbours' places."""
    estimator = pipeline.memory.estimator
    assert estimator is not None
    assert estimator.tracker.watch is not None
    return estimator.tracker.watch.residuals.lasting_t2


def without_one(frame: Frame) -> Frame:
    """As the firmware tells of a sensor that does not answer."""
    there = np.array([True, False, True, True])
    return replace(frame, valid=there, fresh=frame.fresh & there)


@pytest.mark.parametrize("ambient", ["constant", pytest.param("drifting", marks=pytest.mark.long)])
@pytest.mark.parametrize("distance_mm", [25.0, pytest.param(50.0, marks=pytest.mark.long)])
def test_two_pads_that_feel_each_other_say_the_same_in_c_and_in_python(distance_mm: float, ambient: Ambient) -> None:
    """Also while one of them has lost a sensor."""
    pads = pair(distance_mm, ambient, seed=3)
    baselines = {pad.name: simulated_baseline(pad, neighbours_of(pad, pads)) for pad in pads}
    compiled, oracle = pipelines_of(pads, baselines), pipelines_of(pads, baselines)
    for pipeline in oracle.values():
        python_only(pipeline)
    kinds: Counter[Kind | None] = Counter()
    for number, (name, whole) in enumerate(frames_of(pads, 3.0)):
        frame = without_one(whole) if name == "first" and 400 < number < 800 else whole
        answer = compiled[name].answer(frame)
        packed = isinstance(answer, PackedMessage)
        kinds[answer.kind if packed else None] += 1
        assert_same(answer.message if packed else answer, oracle[name].process(frame))
    assert kinds[None] < 40
    assert min(kinds[Kind.QUIET], kinds[Kind.TOUCHED]) > 300
    for pad in pads:  # what each remembers of the other, too
        ours, theirs = compiled[pad.name].be_felt(), oracle[pad.name].be_felt()
        assert ours.time_ns == theirs.time_ns
        np.testing.assert_allclose(ours.table["last"], theirs.table["last"], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=1e-8, atol=1e-18)
        ours_t2, theirs_t2 = (lasting_t2(each[pad.name]) for each in (compiled, oracle))
        np.testing.assert_allclose(ours_t2, theirs_t2, rtol=1e-8)


def test_where_a_magnet_was_seen_is_laid_out_in_c_as_in_python() -> None:
    assert list(_fast.SIGHTING.items()) == list(sighting_layout(1).items())


def test_two_boards_whose_pads_feel_each_other_say_the_same_by_express() -> None:
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
            if host.lane is not None:
                host.end()
        told[may_express] = hosts
        bus.close()
    for pad in pads:
        by_express, by_frames = (told[may_express][pad.name].told for may_express in (True, False))
        assert at_no_time(by_express.messages) == at_no_time(by_frames.messages)
        assert by_express.expressed > 0.85 * len(by_frames.messages)
        assert by_frames.expressed == 0
