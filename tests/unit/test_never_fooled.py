"""Numbers that cannot be, samples that are old, a magnet that something pulls: never a wrong contact that is `ok`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from test_pipeline import PERIOD_NS, config_of, frames_of, pipeline_of

from fmfts.bus.messages import ContactMessage
from fmfts.config import PadConfig
from fmfts.pipeline.pad_pipeline import PadPipeline
from fmfts.sensor import Frame
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import no_finger, steady_finger
from fmfts_simulation.source import Simulated

RATE_HZ = 220
# contact_of_pose.c: how long a temperature is held, and how far a magnet may be above its rest before that counts.
HELD_S, LIFTED_S, RESTED_S = 5.0, 0.6, 0.15
CONFIG = config_of(ambient="drifting")
# Between the quiet and the pressed half of `taps`, its force is neither of the two.
FORCE_N = 1.0


@pytest.fixture
def pipeline() -> PadPipeline:
    return pipeline_of(CONFIG, simulated_baseline(CONFIG))


def taps(seconds: float) -> list[Frame]:
    """Nothing for half of each second, a press of FORCE_N for the other half."""
    press = steady_finger(2e-3, 1e-3, FORCE_N)
    return frames_of(CONFIG, lambda at_s: press(at_s) if at_s % 1.0 > 0.5 else no_finger(at_s), seconds)


def force_n(message: ContactMessage) -> float:
    """The finger's force when the message's sample was taken."""
    return FORCE_N if message.t_sample_ns * 1e-9 % 1.0 > 0.5 else 0.0


def is_wrong(message: ContactMessage) -> bool:
    """More than five deviations off, or a touch where none is. A release takes ten frames to show."""
    if (message.t_sample_ns * 1e-9 + 0.01) % 0.5 < 0.06 or message.contact is None:
        return False
    felt = message.force_n is not None and abs(message.force_n - force_n(message)) > 5.0 * (message.force_sd_n or 0.0)
    return felt or message.contact != (force_n(message) > 0.0)


class TestTemperature:
    @pytest.mark.parametrize("told_c", [281.0, 86.0, -31.0, -231.0, float("nan"), float("inf")])
    def test_impossible_temperature_is_not_used(self, pipeline: PadPipeline, told_c: float) -> None:
        chip = CONFIG.pad().chip
        frames = [
            frame if not 110 < number < 440 else replace(frame, temperature_c=chip.believed_c(told_c))
            for number, frame in enumerate(taps(3.0))
        ]
        messages = [pipeline.process(frame) for frame in frames]
        assert sum(map(is_wrong, messages)) == 0
        assert {message.health for message in messages} == {"ok"}
        assert messages[300].temperature_c is None
        assert messages[-1].temperature_c == pytest.approx(25.0, abs=1.0)

    @pytest.mark.parametrize("count", [32767, -32767])
    def test_impossible_thermometer_count_is_none(self, count: int) -> None:
        assert CONFIG.pad().chip.temperature_c(count) is None

    def test_impossible_temperature_is_reported_after_5_s_and_clears(self, pipeline: PadPipeline) -> None:
        frames = taps(HELD_S + 3.0)
        gone = [replace(frame, temperature_c=None) for frame in frames[RATE_HZ : round((HELD_S + 2.0) * RATE_HZ)]]
        messages = [pipeline.process(frame) for frame in [*frames[:RATE_HZ], *gone]]
        assert messages[-1].health == "degraded"
        assert "temperature" in messages[-1].reason
        assert messages[-1].force_n is not None
        assert messages[round(HELD_S * RATE_HZ)].health == "ok"
        assert not any(map(is_wrong, messages))
        assert pipeline.process(frames[round((HELD_S + 2.0) * RATE_HZ)]).health == "ok"


def test_impossible_converter_count_gives_no_field(pipeline: PadPipeline) -> None:
    frames = taps(1.0)
    counts = frames[150].counts.copy()
    counts[2, 1] = 2048
    messages = [pipeline.process(frame) for frame in frames[:150]]
    sick = pipeline.process(replace(frames[150], counts=counts))
    assert sick.health == "degraded"
    assert "sensor 3" in sick.reason
    assert "converter" in sick.reason
    assert messages[-1].health == "ok"


@pytest.mark.parametrize("clock", ["goes on", "stands"])
def test_frames_without_new_samples_are_old_and_say_so(pipeline: PadPipeline, clock: str) -> None:
    """For three seconds the chips give nothing new, while the finger comes and goes; the board does not notice."""
    frames = taps(5.0)
    last = frames[150]
    old = [
        replace(
            frame,
            counts=last.counts,
            age_us=last.age_us,
            fresh=np.zeros(4, dtype=bool),
            device_time_us=frame.device_time_us if clock == "goes on" else last.device_time_us,
            # When a board's clock stands still for 0.4 s, DeviceClock detects it, and continues from there.
            host_time_ns=frame.host_time_ns if clock == "goes on" or number > 88 else last.host_time_ns,
        )
        for number, frame in enumerate(frames[151:810])
    ]
    messages = [pipeline.process(frame) for frame in frames[:151]]
    stale = [pipeline.process(frame) for frame in old]
    assert not any(message.health == "ok" for message in stale[3:])
    assert {message.contact for message in stale[3:]} == {None}
    assert stale[-1].t_sample_ns <= last.host_time_ns
    assert "without a new sample" in stale[-1].reason
    again = [pipeline.process(frame) for frame in frames[810:]]
    assert again[5].health == "ok"
    assert not any(map(is_wrong, messages + again[5:]))


def test_rare_frames_without_new_samples_become_old_by_time(pipeline: PadPipeline) -> None:
    """A computer that has too little time leaves frames out: three of those that are left may span 60 ms and more."""
    frames = taps(1.5)
    last = frames[150]
    messages = [pipeline.process(frame) for frame in frames[:151]]
    seldom = [
        replace(frame, counts=last.counts, age_us=last.age_us, fresh=np.zeros(4, dtype=bool))
        for frame in frames[156:185:7]
    ]
    stale = [pipeline.process(frame) for frame in seldom]
    assert [message.health for message in stale] == ["lost"] * 5
    assert {message.t_sample_ns for message in stale} == {messages[-1].t_sample_ns}
    assert pipeline.process(frames[186]).health == "ok"


def test_touch_does_not_outlast_a_reset_of_the_board(pipeline: PadPipeline) -> None:
    """Nobody knows how much time passed until its first packet came through: the finger may be gone."""
    frames = taps(1.6)
    messages = [pipeline.process(frame) for frame in frames[:211]]
    assert messages[-1].contact is True
    reset = [
        replace(frame, device_time_us=frame.device_time_us - frames[220].device_time_us, run=1, sequence=number)
        for number, frame in enumerate(frames[229:260])
    ]
    after = [pipeline.process(frame).contact for frame in reset]
    assert True not in after
    assert after[-1] is False


class TestPulledMagnet:
    @staticmethod
    def messages(pipeline: PadPipeline, config: PadConfig, lifted: Callable[[float], float]) -> list[ContactMessage]:
        """lifted: how far the magnet is above its rest (m), at a time (s)."""
        source = Simulated(config)
        source.finger = no_finger
        built = source.built
        messages = []
        for step in range(5 * RATE_HZ):
            above = built.pad.rest_position_m + np.array([0.0, 0.0, lifted(step / RATE_HZ)])
            source._built = replace(built, pad=replace(built.pad, rest_position_m=above))
            messages += [pipeline.process(frame) for frame in source.poll(step * PERIOD_NS)]
        return messages

    @pytest.mark.parametrize("seconds", [0.5, 1.5])
    def test_lifted_magnet_is_no_contact_and_recovers(self, pipeline: PadPipeline, seconds: float) -> None:
        """A sticky thing lifts the magnet by 2 mm within 20 ms, and lets it go after a while."""
        messages = self.messages(
            pipeline,
            CONFIG,
            lambda at_s: 2e-3 * min(max(at_s - 1.0, 0.0) / 0.02, 1.0) if at_s < 1.0 + seconds else 0.0,
        )
        touched = [message for message in messages if message.contact]
        # Below 0.02 mm and the pose's deviations a pull cannot be distinguished from a touch: two frames at this speed.
        assert len(touched) <= 2
        pulled = messages[round(1.1 * RATE_HZ) : round((1.0 + min(seconds, LIFTED_S) - 0.02) * RATE_HZ)]
        assert {message.health for message in pulled} == {"disturbed"}
        assert "above its rest" in pulled[0].reason
        if seconds > LIFTED_S:
            latched = messages[round((0.98 + seconds) * RATE_HZ)]
            assert latched.health == "no_baseline"
            assert "by itself" in latched.reason
        assert {message.health for message in messages[round((1.1 + seconds + RESTED_S) * RATE_HZ) :]} == {"ok"}

    def test_lifted_magnet_keeps_the_pad_without_baseline(self, pipeline: PadPipeline) -> None:
        messages = self.messages(pipeline, CONFIG, lambda at_s: 0.0 if at_s < 1.0 else 0.3e-3)
        assert {message.health for message in messages[round((1.1 + LIFTED_S) * RATE_HZ) :]} == {"no_baseline"}
