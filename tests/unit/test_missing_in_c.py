"""Frames that go on without a sensor or an axis, in C: the same messages as by the stages in Python."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from test_healthy_path import assert_same, both, compared, python_only
from test_pipeline import PERIOD_NS, config_of, pipeline_of

from fmfts.config import PadConfig
from fmfts.pipeline.contact_message import PackedMessage
from fmfts.pipeline.fast import Kind
from fmfts.sensor import Frame
from fmfts.simulation.baseline import simulated_baseline
from fmfts.simulation.finger import Touch, no_finger
from fmfts.simulation.source import Simulated

Spoil = Callable[[Frame], Frame]
BEGINS, ENDS = 110, 660


def silent(frame: Frame) -> Frame:
    """As the firmware tells of a sensor that does not answer."""
    there = np.array([True, False, True, True])
    age_us = np.where(there, frame.age_us, 65535).astype(np.uint16)
    return replace(frame, valid=there, fresh=frame.fresh & there, age_us=age_us)


def saturated(frame: Frame) -> Frame:
    counts = frame.counts.copy()
    counts[3, 2] = -4096
    return replace(frame, counts=counts)


def silent_and_saturated(frame: Frame) -> Frame:
    """Two of four sensors are not whole: `lost`, which Python says."""
    return saturated(silent(frame))


def taps(config: PadConfig, seconds: float) -> list[Frame]:
    """Presses of 0.3 s, from 0.2 to 2.2 N, with pauses of as long."""
    source = Simulated(config)

    def finger(time_s: float) -> Touch:
        pressed = time_s % 0.6 > 0.3 and time_s > 0.3
        return Touch(2e-3, -1e-3, 0.2 + 0.5 * (time_s // 0.6 % 5)) if pressed else no_finger(time_s)

    source.finger = finger
    return [frame for step in range(round(seconds * 220)) for frame in source.poll(step * PERIOD_NS)]


@pytest.mark.parametrize(
    ("spoil", "scene"),
    [
        (silent, "drifting"),
        (saturated, "constant"),
        pytest.param(silent, "constant", marks=pytest.mark.long),
        pytest.param(saturated, "drifting", marks=pytest.mark.long),
    ],
)
def test_what_goes_on_without_a_sensor_is_said_in_c(spoil: Spoil, scene: str) -> None:
    config = config_of(21, ambient=scene)
    frames = taps(config, 4.0)
    spoilt = [*frames[:BEGINS], *map(spoil, frames[BEGINS:ENDS]), *frames[ENDS:]]
    baseline = simulated_baseline(config)
    compiled, oracle = pipeline_of(config, baseline), pipeline_of(config, baseline)
    compared(compiled, python_only(oracle), spoilt[:BEGINS])
    kinds = compared(compiled, oracle, spoilt[BEGINS:ENDS])
    assert kinds[None] < 0.1 * (ENDS - BEGINS)
    assert min(kinds[Kind.QUIET], kinds[Kind.TOUCHED]) > 100
    assert "sensor" in compiled.process(spoilt[ENDS - 1]).reason
    oracle.process(spoilt[ENDS - 1])
    assert compiled.missing == oracle.missing != {}
    after = compared(compiled, oracle, spoilt[ENDS:])
    assert after[None] < 40
    assert compiled.missing == {}


@pytest.mark.parametrize("scene", ["constant", pytest.param("drifting", marks=pytest.mark.long)])
def test_what_goes_on_without_a_sensor_that_contradicts_the_others_is_said_in_c(scene: str) -> None:
    """Python looks at one frame in eight whether the fault has ended, and at the field of a constant scene."""
    config = config_of(26, ambient=scene)
    frames, offset = taps(config, 4.0), np.zeros((4, 3), np.int16)
    offset[1, 0] = 150
    spoilt = [
        replace(frame, counts=frame.counts + offset) if BEGINS <= number < ENDS else frame
        for number, frame in enumerate(frames)
    ]
    baseline = simulated_baseline(config)
    compiled, oracle = pipeline_of(config, baseline), python_only(pipeline_of(config, baseline))
    compared(compiled, oracle, spoilt[:BEGINS])
    kinds = compared(compiled, oracle, spoilt[BEGINS:ENDS])
    assert kinds[None] < 0.4 * (ENDS - BEGINS)
    assert min(kinds[Kind.QUIET], kinds[Kind.TOUCHED]) > 100
    after = [compiled.process(frame) for frame in spoilt[ENDS:]]
    assert after[40].health == "ok"
    assert [message.health for message in after] == [oracle.process(frame).health for frame in spoilt[ENDS:]]


def test_messages_of_c_tell_which_sensor_is_missing_and_no_now() -> None:
    config = config_of(22)
    frames = taps(config, 2.0)
    pipeline = pipeline_of(config, simulated_baseline(config))
    answers = [pipeline.answer(frame) for frame in [*frames[:BEGINS], *map(silent, frames[BEGINS:])]]
    last = answers[-1]
    assert isinstance(last, PackedMessage)
    message = last.message
    assert (message.health, message.reason) == ("degraded", "sensor 2 is silent: left out")
    assert message.sensors_ok == 0b1101
    assert message.now is None
    assert message.pose is not None


def test_another_sensor_that_fails_meanwhile_is_judged_in_python() -> None:
    config = config_of(23)
    frames = taps(config, 3.0)
    spoilt = [*frames[:BEGINS], *map(silent, frames[BEGINS:330]), *map(silent_and_saturated, frames[330:])]
    baseline = simulated_baseline(config)
    pipeline, oracle = pipeline_of(config, baseline), python_only(pipeline_of(config, baseline))
    answers = [pipeline.answer(frame) for frame in spoilt]
    assert isinstance(answers[329], PackedMessage)
    assert not any(isinstance(answer, PackedMessage) for answer in answers[330:])
    for frame, answer in zip(spoilt, answers, strict=True):
        assert_same(answer.message if isinstance(answer, PackedMessage) else answer, oracle.process(frame))
    assert pipeline.process(spoilt[-1]).health == "lost"


def test_faults_beside_a_silent_sensor_are_the_same_in_c_and_in_python() -> None:
    """An offset that only the mean shows, steel, a stuck axis and a jump, each while one sensor is silent."""
    config = config_of(24, ambient="constant")
    frames = [silent(frame) for frame in taps(config, 6.0)]
    offset, steel = np.zeros((4, 3), np.int16), np.zeros((4, 3), np.int16)
    offset[2, 0], steel[:, 2] = 8, (60, -40, 20, -80)
    for number, frame in enumerate(frames):
        counts = frame.counts.copy()
        if 300 < number < 500:
            counts += offset
        elif 600 < number < 640:
            counts += steel
        elif 800 < number < 900:
            counts[3, 1] = frames[800].counts[3, 1]
        elif 1000 < number < 1003:
            counts[0, 0] = np.clip(counts[0, 0] + 500, -2048, 2047)
        frames[number] = replace(frame, counts=counts)
    kinds = both(config, frames)
    assert kinds[None] > 100
    assert kinds[Kind.QUIET] + kinds[Kind.TOUCHED] > 600


def test_a_silent_sensor_makes_no_jump() -> None:
    """Its last two samples lie far from the line through those before. They are not used: nothing has jumped."""
    config = config_of(25)
    frames = taps(config, 1.0)
    counts = frames[BEGINS].counts.copy()
    counts[1] += 300
    frames[BEGINS] = replace(frames[BEGINS], counts=counts)
    pipeline = pipeline_of(config, simulated_baseline(config))
    pipeline.hand_back()
    said = [pipeline.process(frame) for frame in [*frames[: BEGINS + 1], *map(silent, frames[BEGINS + 1 :])]]
    assert not any("jumped" in message.reason for message in said[BEGINS + 1 :])
