"""The duration of a recording if a busy computer loses frames."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmfts.baseline.job import EXTRA_S, OVERTIME_S, SETTLING_S, BaselineJob, Collection
from fmfts.baseline.request import BaselineRequest
from fmfts.config import PadConfig, SimulatedSource
from fmfts.sensor import Frame
from fmfts.sensor.tasks import OPENING_S, PATIENCE_S
from fmfts_lab.bench.drills import record
from fmfts_simulation.baseline import hold_still
from fmfts_simulation.finger import no_finger
from fmfts_simulation.source import Simulated


def collected(every: int, duration_s: float, fewest: int) -> tuple[int, float]:
    """Frames and time until a recording is complete that receives only each `every`-th frame."""
    source = Simulated(PadConfig(name="left", source=SimulatedSource()))
    source.finger = no_finger
    collection = Collection(source, duration_s, fewest)
    for frame in record(source, no_finger, 5.0)[::every]:
        if not collection.complete:
            collection.take(frame)
    taken = collection.frames
    return len(taken), (taken[-1].device_time_us - taken[0].device_time_us) * 1e-6


def test_lossless_recording_ends_on_time() -> None:
    count, spent_s = collected(1, 0.5, 50)
    assert 109 <= count <= 113  # the board's clock is off by up to 1 %
    assert round(spent_s, 1) == 0.5


def test_recording_continues_until_it_has_enough_frames() -> None:
    count, spent_s = collected(5, 0.5, 50)
    assert count == 50
    assert spent_s < 0.5 + EXTRA_S


def test_recording_ends_even_if_frames_are_missing() -> None:
    count, spent_s = collected(50, 0.5, 50)
    assert count < 50
    assert 0.5 + EXTRA_S <= spent_s < 0.5 + EXTRA_S + 1.0


def test_recording_begins_when_board_has_configured_range() -> None:
    source = Simulated(PadConfig(name="left", source=SimulatedSource()))
    frames = record(source, no_finger, 2.0)
    before = int(SETTLING_S * 220) - 10

    def taken(others: range) -> list[int]:
        collection = Collection(source, 0.5)
        for number, frame in enumerate(frames):
            if not collection.complete:
                collection.take(replace(frame, gain_code=7) if number in others else frame)
        return [frame.gain_code for frame in collection.frames]

    assert 7 not in taken(range(before))
    assert len(taken(range(before))) >= 109
    # Whoever changes it later has to record again: nothing says which half belongs to the pad.
    settled = before + 20
    collection = Collection(source, 1.0)
    for number, frame in enumerate(frames[:400]):
        collection.take(frame if number < settled else replace(frame, gain_code=7))
    assert len({frame.gain_code for frame in collection.frames}) == 2


def test_baseline_waits_until_each_sensor_has_enough_samples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fifth of the frames arrives, and one sensor has no new sample in every tenth of them."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    config = PadConfig(name="left", source=SimulatedSource())
    source = Simulated(config)
    hold_still(source, mounted=False)
    request = BaselineRequest(config.pad(), config.tolerance.si(), bare=True, replaced=False, duration_s=1.0)
    sparse = record(source, no_finger, 5.0)[::5]
    late = np.array([True, False, True, True])
    sparse[::10] = [replace(frame, fresh=late) for frame in sparse[::10]]
    with ThreadPoolExecutor(1) as executor:
        job = BaselineJob(request, None, source, executor)
        for frame in sparse:
            job.take(frame)
    assert job.recorded is not None


def after(frames: list[Frame], instant_s: float, device_s: float = 0.0, host_s: float = 0.0) -> list[Frame]:
    """The frames from that instant on with both clocks moved."""
    start_us = frames[0].device_time_us
    late = [frame for frame in frames if (frame.device_time_us - start_us) * 1e-6 >= instant_s]
    return [
        replace(
            frame,
            device_time_us=frame.device_time_us + round(device_s * 1e6),
            host_time_ns=frame.host_time_ns + round(host_s * 1e9),
        )
        for frame in late
    ]


def problem_after(frames: list[Frame]) -> str:
    collection = Collection(Simulated(PadConfig(name="left", source=SimulatedSource())), 5.0)
    for frame in frames:
        collection.take(frame)
    return collection.problem(time.monotonic())


def test_stalled_computer_is_no_leap_of_the_device_clock() -> None:
    """It reads frames of 0.5 to 0.6 s 0.8 s late, loses 0.6 to 1.4 s, and is in time again."""
    frames = record(Simulated(PadConfig(name="left", source=SimulatedSource())), no_finger, 2.0)
    kept = len(frames) - len(after(frames, 0.5))
    late = after(frames, 0.5, host_s=0.8)[:22]
    assert problem_after(frames[:kept] + late + after(frames, 1.4)) == ""


@pytest.mark.parametrize("leap_s", [-0.2, 0.4, 30.0])
def test_leap_of_the_device_clock_ends_a_recording(leap_s: float) -> None:
    frames = record(Simulated(PadConfig(name="left", source=SimulatedSource())), no_finger, 2.0)
    kept = len(frames) - len(after(frames, 0.5))
    assert "clock leapt" in problem_after(frames[:kept] + after(frames, 0.5, device_s=leap_s))


def test_silence_is_reported_with_the_source_cause() -> None:
    source = Simulated(PadConfig(name="left", source=SimulatedSource()))
    source.poll(time.monotonic_ns())
    source.state.sensor_faults[0, 1] = 'sensor 2 is a QMC5883L at 0x0D, not an HMC5983: set chip = "qmc5883l"'
    source.state.sensor_faults[1, 0] = "sensor 1 is another pad's"
    problem = Collection(source, 0.5).problem(time.monotonic() + PATIENCE_S + 0.1)
    assert problem.endswith(
        'no frame within 3 s: sensor 2 is a QMC5883L at 0x0D, not an HMC5983: set chip = "qmc5883l"'
    )


def test_seconds_in_which_a_device_is_opened_do_not_count_as_silence() -> None:
    """A slow computer takes several of them to start the process that reads an I2C bus."""
    source = Simulated(PadConfig(name="left", source=SimulatedSource()))
    collection, begun_s = Collection(source, 0.5), time.monotonic()
    opened_s = begun_s + 3.0 * PATIENCE_S
    assert collection.problem(opened_s) == ""
    source.poll(time.monotonic_ns())
    assert collection.problem(opened_s + 0.9 * PATIENCE_S) == ""
    assert "no frame within 3 s" in collection.problem(opened_s + 1.1 * PATIENCE_S)


def test_device_that_is_being_opened_for_ever_is_reported() -> None:
    source = Simulated(PadConfig(name="left", source=SimulatedSource()))
    collection, begun_s = Collection(source, 0.5), time.monotonic()
    assert collection.problem(begun_s + 0.9 * OPENING_S) == ""
    assert collection.problem(begun_s + OPENING_S + PATIENCE_S).endswith("it is being opened")


def test_board_that_resets_again_and_again_makes_no_recording_without_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """It begins with another range each time, before the recorder's request for the configured one arrives."""
    source, now_s = Simulated(PadConfig(name="left", source=SimulatedSource())), 0.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    some = record(source, no_finger, 0.5)[:80]
    collection = Collection(source, 0.5)
    while now_s < 60.0 and not collection.problem(now_s):
        for number, frame in enumerate(some):
            collection.take(replace(frame, gain_code=frame.gain_code - (number < 5)))
        now_s += 0.4
    assert now_s < 0.5 + OVERTIME_S + 1.0
    assert not collection.complete
