"""`now` of a pad with four magnets: the contact when its message is published, and after each sample."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi

import msgspec
import numpy as np
import pytest

from fmfts.bus.messages import ContactMessage
from fmfts.pipeline.configured import contact_model_of, lead_of, pipeline_of
from fmfts.pipeline.finger import FollowedFinger
from fmfts.pipeline.lead import Lead
from fmfts.pipeline.several_pipeline import SeveralPipeline
from fmfts.pipeline.snapshot import BadMemoryError, restore, snapshot
from fmfts.sensor import Frame
from fmfts.sensor.early import EarlySample
from fmfts_lab.bench import several_now
from fmfts_lab.bench.now import Errors, Run
from fmfts_lab.finite_elements.array_pad import array_config
from fmfts_simulation.array import SimulatedArray
from fmfts_simulation.baseline import simulated_baseline
from fmfts_simulation.finger import Finger, Touch, no_finger, steady_finger

CONFIG = array_config(seed=3)
RATE_HZ, EARLY_S = 220, 1.1e-3
OTHER = steady_finger(8e-3, 7e-3, 0.7)


def tapping(time_s: float) -> Touch:
    """1 N taps of 50 ms, one after another."""
    return Touch(3e-3, -4e-3, 0.5 * (1.0 - cos(2.0 * pi * time_s / 50e-3)) if time_s > 0.3 else 0.0)


def ready(early_s: float = 0.0) -> SeveralPipeline:
    made = pipeline_of(CONFIG, contact_model_of(CONFIG), "boot")
    assert isinstance(made, SeveralPipeline)
    made._lead = Lead(lead_of(CONFIG).frame_s, early_s)
    made.use(simulated_baseline(CONFIG))
    return made


def frames(count: int, finger: Finger = no_finger, second: Finger | None = None) -> list[Frame]:
    source, found = SimulatedArray(CONFIG), list[Frame]()
    source.finger, source.second_finger = finger, second
    for step in range(count + 1):
        found.extend(source.poll(round(step * 1e9 / RATE_HZ)))
    return found[:count]


def off_n(messages: list[ContactMessage]) -> tuple[float, float]:
    """Root mean square of the error of `now`, and of the frame's force taken for that at the same time."""
    told = [message for message in messages if message.now is not None and message.t_sample_ns > 0.32e9]
    truth = np.array([tapping(message.now.t_ns * 1e-9).force_n for message in told if message.now is not None])
    now = np.array([message.now.force_n for message in told if message.now is not None])
    today = np.array([message.force_n for message in told], dtype=float)
    return float(np.sqrt(np.mean(np.square(now - truth)))), float(np.sqrt(np.mean(np.square(today - truth))))


def test_now_of_four_magnets_follows_a_tap_of_50_ms() -> None:
    made = ready()
    messages = [made.process(frame) for frame in frames(220, tapping)]
    now_n, today_n = off_n(messages)
    assert now_n < 0.1 < 0.15 < today_n
    assert sum(message.now is None for message in messages[80:]) <= 2


def test_newest_samples_show_a_finger_that_the_frame_does_not() -> None:
    made = ready()
    messages = [made.process(frame) for frame in frames(220, tapping)]
    ahead = [message for message in messages if message.contact is False and message.now and message.now.force_n > 0.1]
    assert len(ahead) >= 2
    assert all(tapping(message.now.t_ns * 1e-9).force_n > 0.05 for message in ahead if message.now)


def test_tap_in_the_middle_is_shown_before_any_frame_has_it() -> None:
    """It lowers all magnets alike, as if they were colder, and the samples of a frame see more and more of it."""

    def in_the_middle(time_s: float) -> Touch:
        return Touch(1e-3, 1.5e-3, tapping(time_s).force_n)

    made = ready()
    messages = [made.process(frame) for frame in frames(220, in_the_middle)]
    ahead = [message for message in messages if message.contact is False and message.now and message.now.force_n > 0.05]
    assert len(ahead) >= 20  # of 14 taps
    assert off_n(messages)[0] < 0.03
    assert all(message.now is not None for message in messages[80:])


def test_place_of_now_while_a_force_rises_is_no_worse_than_that_of_the_frame() -> None:
    """The newest samples show the finger before any frame does, and hardly know its place: the first frame that has the
    finger begins anew."""
    ((config, motions),) = several_now.drawn(1, 1, 2.0, config_of=several_now._built)
    (ramp,) = (motion for motion in motions if motion.name == "ramp 30 N/s")
    errors = Errors()
    errors.add(Run.of(ramp, *several_now._messages(config, ramp, 2.0, samples=False)))
    facts = errors.facts()
    assert 0.0 < facts["place_now_mm"] < facts["place_today_mm"]
    assert errors.withheld == 0


def test_now_of_an_untouched_pad_is_no_force_without_a_place() -> None:
    made = ready()
    now = [made.process(frame) for frame in frames(20)][-1].now
    assert now is not None
    assert (now.force_n, now.x_m, now.shear_x_n) == (0.0, None, None)
    assert 0.0 < now.force_sd_n < 0.4


def test_now_is_null_under_two_fingers() -> None:
    made = ready()
    last = [made.process(frame) for frame in frames(40, steady_finger(-6e-3, -2e-3, 1.0), OTHER)][-1]
    assert last.contacts
    assert len(last.contacts) == 2
    assert last.now is None


def samples_of(frame: Frame) -> list[EarlySample]:
    fresh = sorted(np.flatnonzero(frame.fresh).tolist(), key=lambda sensor: int(frame.sampled_us[sensor]))
    found = []
    for sensor in fresh:
        x, y, z = frame.counts[sensor].tolist()
        found.append(EarlySample(0, sensor, int(frame.sampled_us[sensor]), frame.gain_code, (x, y, z), frame.chip))
    return found


def test_samples_before_their_frame_bring_a_newer_now() -> None:
    made, before, brought = ready(EARLY_S), ready(), list[ContactMessage]()
    alone = [before.process(frame) for frame in frames(220, tapping)]
    numbers = list[int]()
    for frame in frames(220, tapping):
        told = [answer.message for sample in samples_of(frame) if (answer := made.early(sample)) is not None]
        last = made.process(frame)
        brought += told
        numbers += [message.seq for message in (*told, last)]
        assert last.now is None or last.now.t_ns > frame.host_time_ns - 10_000_000
    assert len(brought) > 600
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), "whoever loses one sees the gap"
    assert off_n(brought)[0] < off_n(alone)[0] < 0.03


def test_sample_before_its_frame_shows_a_finger_that_no_frame_has_shown() -> None:
    """Nothing pressed in the last frame, whose message it repeats, with another `now`."""

    def later(time_s: float) -> Touch:
        return tapping(time_s - 3e-3)

    made = ready(EARLY_S)
    for frame in frames(80, later):
        told = [answer.message for sample in samples_of(frame) if (answer := made.early(sample)) is not None]
        if told:
            break
        last = made.process(frame)
        assert last.now is not None
        assert last.now.force_n == 0.0
    first = told[0]
    assert first.contact is False
    assert first.now is not None
    assert 0.0 < first.now.force_n == pytest.approx(later(first.now.t_ns * 1e-9).force_n, abs=0.15)
    assert later(first.now.t_ns * 1e-9).force_n < 0.25


def test_only_new_sample_that_a_finger_may_have_changed_is_looked_at() -> None:
    made, some = ready(EARLY_S), frames(20)
    for frame in some:
        made.process(frame)
    assert made._followed is not None
    sample = samples_of(some[-1])[-1]
    (x, y, z), step_t = sample.counts, sample.chip.step_t[sample.gain_code][0]

    def is_looked_at(change_t: float, later_us: int) -> bool:
        counts, time_us = (x + round(change_t / step_t), y, z), sample.device_time_us + later_us
        return made._frames.compiled.follow_early(sample.sensor, sample.gain_code, *counts, time_us, None) is True

    assert is_looked_at(2e-5, 4500)
    assert not is_looked_at(5e-7, 4500)  # noise
    assert not is_looked_at(6e-5, 4500)  # a jump, as from a moved wire
    assert not is_looked_at(2e-5, 0)  # the frame contained it
    assert not is_looked_at(2e-5, 1_000_000)


def beside_mains(quiet: Frame, most_t: float, phase: float = 0.0) -> Frame:
    mains_t = most_t * np.sin(2.0 * np.pi * 50e-6 * quiet.sampled_us + phase)[:, None] * [0.5, 0.3, 0.8]
    counts = quiet.counts + np.round(mains_t / quiet.chip.step_t[quiet.gain_code]).astype(np.int16)
    return replace(quiet, counts=counts)


def test_mains_beside_an_untouched_pad_are_hardly_ever_a_finger() -> None:
    """20 µT change the samples of a frame by a hundred times the noise, each at another time."""
    now = []
    for phase in range(4):
        made = ready()
        now += [made.process(beside_mains(quiet, 2e-5, phase)).now for quiet in frames(150)]
    pressed = [one for one in now if one is not None and one.force_n > 0.0]
    assert len(pressed) <= 0.02 * len(now)
    assert all(one.force_n < 5.0 * one.force_sd_n for one in pressed)


def test_mains_beside_an_untouched_pad_are_looked_at_about_once_a_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """50 Hz of 2 µT change most of the 8 samples since a frame by more than noise does; all of those were looked at."""
    made, looked = ready(EARLY_S), list[bool]()
    look_ahead = FollowedFinger._look_ahead

    def counted(followed: FollowedFinger) -> memoryview | None:
        found = look_ahead(followed)
        looked.append(found is not None)
        return found

    monkeypatch.setattr(FollowedFinger, "_look_ahead", counted)
    for_samples, some = 0, [beside_mains(quiet, 2e-6) for quiet in frames(150)]
    for frame in some:
        before = len(looked)
        for sample in samples_of(frame):
            made.early(sample)
        for_samples += len(looked) - before
        made.process(frame)
    assert 10 < for_samples < 1.25 * len(some)


def test_sample_of_another_time_is_not_taken() -> None:
    made = ready(EARLY_S)
    some = frames(60, steady_finger(3e-3, -4e-3, 1.0))
    for frame in some:
        made.process(frame)
    (sample, *_) = samples_of(some[-1])
    assert made.early(sample) is None  # the frame contained it
    assert made.early(replace(sample, device_time_us=sample.device_time_us + 1_000_000)) is None
    with pytest.raises(ValueError, match="no board counts so far"):
        made.early(replace(sample, device_time_us=2**62))
    assert made.early(replace(sample, sensor=15, device_time_us=sample.device_time_us + 4000)) is None


def test_memory_keeps_now_to_the_last_bit() -> None:
    some, made = frames(160, tapping), ready()
    for frame in some[:100]:
        made.process(frame)
    again = ready()
    restore(again, snapshot(made))
    for frame in some[100:]:
        assert made.process(frame).now == again.process(frame).now


@pytest.mark.parametrize("sensor", [2, 6])
def test_now_is_null_with_a_silent_sensor(sensor: int) -> None:
    made = ready()
    for frame in frames(60, steady_finger(3e-3, -4e-3, 1.0)):
        valid = frame.valid.copy()
        valid[sensor] = frame.sequence < 40
        last = made.process(replace(frame, valid=valid))
    assert (last.health, last.now) == ("degraded", None)


@pytest.mark.parametrize("later", ["calm_drift", "blamed"])
def test_state_of_a_version_without_a_later_field_is_taken(later: str) -> None:
    some, made, again = frames(60, tapping), ready(), ready()
    for frame in some[:40]:
        made.process(frame)
    memory = made.memory
    again.recall(replace(memory, fields={name: value for name, value in memory.fields.items() if name != later}))
    for frame in some[40:]:
        assert made.process(frame).now == again.process(frame).now


def test_state_of_a_version_without_now_is_refused_in_words() -> None:
    made = ready()
    made.process(frames(1)[0])
    state = msgspec.msgpack.decode(snapshot(made))
    state["memory"]["followed"] = None
    with pytest.raises(BadMemoryError, match="this pad remembers followed, and the state does not"):
        restore(ready(), msgspec.msgpack.encode(state))
