"""The simulated pad as a source: its clocks, its counts, its finger, and how far it is from its drawing."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from fmfts.config import BridgeSource, PadConfig, SimulatedSource
from fmfts.sensor.frame import Frame
from fmfts_simulation.finger import CYCLE_S, SQUEEZE_N, UNLOADED_AT_START_S, ScriptedFinger, no_finger, steady_finger
from fmfts_simulation.source import CATCH_UP_FRAMES, Simulated

START_NS = 5_000_000_000_000
PERIOD_NS = 1e9 / 220


def config(**source: Any) -> PadConfig:
    return PadConfig(name="demo", source=SimulatedSource(**source))


def run(source: Simulated, seconds: float) -> list[Frame]:
    """All frames of the first seconds, polled when the source asks to be."""
    now_ns, frames = START_NS, []
    while now_ns <= START_NS + seconds * 1e9:
        frames.extend(source.poll(now_ns))
        now_ns = source.deadline_ns()
    return frames


def same(one: Frame, other: Frame) -> bool:
    return (one.sequence, one.device_time_us, one.host_time_ns) == (
        other.sequence,
        other.device_time_us,
        other.host_time_ns,
    ) and all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("counts", "age_us", "fresh", "valid")
    )


def test_same_seed_gives_same_frames_however_often_it_is_polled() -> None:
    asked, hurried = Simulated(config()), Simulated(config())
    frames = run(asked, 5.0)
    more = [frame for step in range(10_000) for frame in hurried.poll(START_NS + step * 500_000)]
    assert len(more) == 1100
    assert all(same(one, other) for one, other in zip(frames, more, strict=False))
    assert not same(run(Simulated(config(seed=2)), 0.0)[0], frames[0])


def test_frames_come_at_220_hz_without_gaps_and_never_from_future() -> None:
    source = Simulated(config())
    polled = [(now, frame) for now in range(START_NS, START_NS + 10**10, 2 * 10**6) for frame in source.poll(now)]
    assert [frame.sequence for _, frame in polled] == list(range(2200))
    late_ns = np.array([now - frame.host_time_ns for now, frame in polled])
    assert late_ns.min() >= 0
    assert late_ns.max() < PERIOD_NS * 1.03 + 2e6  # one chip period, and one turn of this loop


def test_chips_run_on_their_own_clocks() -> None:
    """±3 %: a slow chip has nothing new in some frames, and samples differ in age by up to a chip's period."""
    source = Simulated(config())
    frames = run(source, 20.0)
    fresh_share = np.mean([frame.fresh for frame in frames], axis=0)
    assert (fresh_share >= 0.969).all()
    assert fresh_share.min() < 0.999
    age_us = np.array([frame.age_us for frame in frames])
    assert (age_us.min(axis=1) == 0).all()
    assert 3000 < age_us.max() < PERIOD_NS * 1e-3 * 1.031 + 1
    for before, after in pairwise(frames):
        stale = ~after.fresh
        np.testing.assert_array_equal(after.counts[stale], before.counts[stale])


def test_simultaneous_trigger_gives_fresh_samples_of_one_age() -> None:
    frames = run(Simulated(config(trigger="simultaneous", rate_hz=160)), 1.0)
    assert len(frames) == 161
    assert all(frame.fresh.all() and not frame.age_us.any() for frame in frames)


def test_after_stall_only_newest_frames_come_and_gap_shows() -> None:
    source = Simulated(config())
    source.poll(START_NS)
    frames = source.poll(START_NS + 10**9)
    assert len(frames) == CATCH_UP_FRAMES
    assert frames[-1].sequence == 220
    assert source.deadline_ns() > START_NS + 10**9


def test_noise_is_two_milligauss_and_its_rounding() -> None:
    """hypot(2 mG, 1/√12 of 1/660 G) at ±2.5 G; 1000 samples of 12 axes give it to 1 % (4 σ = 3 %)."""
    source = Simulated(config(trigger="simultaneous", rate_hz=160, turning_deg_per_s=0.0))
    source.finger = no_finger
    field_t = np.array([frame.field_t for frame in run(source, 6.24)])
    expected = np.hypot(0.2e-6, 1e-4 / 660 / np.sqrt(12))
    assert np.sqrt(field_t.var(axis=0, ddof=1).mean()) == pytest.approx(expected, rel=0.03)


def test_field_beyond_the_converter_is_marked_as_overflow() -> None:
    """At 1370 counts per gauss the converter ends at 1.49 G: a firm press has 1.88 G in x and y, 0.56 G in z."""
    source = Simulated(config(range_gauss=0.88), perfect=True)
    source.finger = steady_finger(0.0, 0.0, 1.9)
    frame = run(source, 0.0)[0]
    np.testing.assert_array_equal(frame.overflow, [[True, True, False]] * 4)
    np.testing.assert_array_equal(frame.counts[:, :2], -4096)


def test_perfect_pad_is_its_drawing_and_a_built_one_is_near_it() -> None:
    def field_t(perfect: bool, mounted: bool = True) -> np.ndarray:
        source = Simulated(config(), perfect=perfect)
        source.finger, source.mounted = no_finger, mounted
        return np.mean([frame.field_t for frame in run(source, 2.0)], axis=0)

    ambient_t = field_t(perfect=False, mounted=False)
    assert np.abs(field_t(perfect=True, mounted=False)).max() < 0.05e-6
    # The Earth's 50 µT, seen by every sensor through gains within a few times 0.5 %.
    np.testing.assert_allclose(np.linalg.norm(ambient_t, axis=1), 50e-6, rtol=0.02)
    error_t = field_t(perfect=False) - ambient_t - field_t(perfect=True)
    # 0.1 mm of magnet and sensors, 1°, 0.5 % and 1 %: some µT, of 165.
    assert 1e-6 < np.sqrt(np.mean(error_t**2)) < 10e-6


def test_warming_weakens_the_magnet_and_shows_in_the_temperature() -> None:
    """60 K/min towards +15 K; magnet −0.12 %/K and compensated chips −0.03 %/K: −1.1 % at 7.3 K."""
    source = Simulated(config(warming_k_per_minute=60.0), perfect=True)
    source.finger = no_finger
    frames = run(source, 10.0)
    warming = 15.0 * (1.0 - np.exp(-10.0 / 15.0))
    assert frames[-1].temperature_c == pytest.approx(25.0 + warming, abs=1 / 128)
    first, last = (np.mean([abs(frame.field_t) for frame in part], axis=0) for part in (frames[:22], frames[-22:]))
    assert (last / first).mean() - 1.0 == pytest.approx(-0.0015 * warming, rel=0.05)


def test_self_test_measures_each_axis_gain_through_counts() -> None:
    source = Simulated(config())
    assert source.selftest_result(0) is None
    source.request_selftest(0)
    facts = source.selftest_result(0)
    assert facts is not None
    assert facts["passed"] is True
    sensors = facts["sensors"]
    assert isinstance(sensors, list)
    factors = np.array([sensor["gain_factor"] for sensor in sensors])
    assert 0.001 < factors.std() < 0.01  # ±0.5 % of gain, and half a count of 450
    assert abs(factors.mean() - 1.0) < 0.006


def test_finger_taps_presses_slides_and_squeezes_in_every_cycle() -> None:
    finger = ScriptedFinger(seed=1)
    times = np.arange(round((UNLOADED_AT_START_S + 3 * CYCLE_S) * 100)) / 100
    touches = [finger(time) for time in times]
    force_n = np.array([touch.force_n for touch in touches])
    assert not force_n[times <= UNLOADED_AT_START_S].any()
    assert np.abs([touch[:2] for touch in touches]).max() <= 8e-3
    cycles = force_n[times >= UNLOADED_AT_START_S].reshape(3, -1)
    for cycle in cycles:
        onsets = np.count_nonzero((cycle[1:] > 0.0) & (cycle[:-1] == 0.0))
        assert onsets == 7
        assert cycle.max() == pytest.approx(SQUEEZE_N)
        assert 0.02 < np.mean(cycle > 1.98) < 0.06  # the squeeze is brief
        assert 0.3 < np.mean(cycle == 0.0) < 0.6
    assert not np.allclose(cycles[0], cycles[1])


def test_finger_slides_over_the_pad_while_it_presses() -> None:
    finger = ScriptedFinger(seed=1)
    slide = [finger(UNLOADED_AT_START_S + 5.1 + step / 10) for step in range(21)]
    force_n = [touch.force_n for touch in slide]
    assert min(force_n) == max(force_n) > 0.8
    steps_m = np.linalg.norm(np.diff([touch[:2] for touch in slide], axis=0), axis=1)
    np.testing.assert_allclose(steps_m, steps_m[0])
    assert steps_m.sum() > 1e-3


def test_finger_has_no_jumps() -> None:
    """The fastest ramp is 1 N in 50 ms: at most 0.04 N in a millisecond."""
    finger = ScriptedFinger(seed=3)
    force_n = np.array([finger(time).force_n for time in np.arange(0.0, 40.0, 0.001)])
    assert np.abs(np.diff(force_n)).max() < 0.05


def test_truth_is_the_fingers_own() -> None:
    source = Simulated(config())
    source.finger = steady_finger(1e-3, -2e-3, 0.7)
    source.poll(START_NS)
    assert source.truth(START_NS + 10**9) == (1e-3, -2e-3, 0.7)


def test_another_kind_of_source_is_refused() -> None:
    with pytest.raises(ValueError, match="not a simulated one"):
        Simulated(PadConfig(name="arm", source=BridgeSource(port="/dev/ttyUSB0")))


def test_turning_robot_shows_every_sensor_the_same_turning_field() -> None:
    """20° a second for a quarter turn; half a gauss throughout, and gains of ±0.5 %."""
    source = Simulated(config(turning_deg_per_s=20.0))
    source.finger, source.mounted = no_finger, False
    field_t = np.array([frame.field_t for frame in run(source, 4.5)])
    assert np.linalg.norm(field_t, axis=2) == pytest.approx(50e-6, rel=0.04)
    first, last = field_t[:20].mean(axis=0), field_t[-20:].mean(axis=0)
    turned_deg = np.degrees(
        np.arccos((first * last).sum(axis=1) / np.linalg.norm(first, axis=1) / np.linalg.norm(last, axis=1))
    )
    assert np.ptp(turned_deg) < 2.0
    assert 20.0 < turned_deg.mean() < 91.0
