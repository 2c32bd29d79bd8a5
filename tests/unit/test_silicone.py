"""A pad whose silicone creeps: its recovery is no touch and no drift, and its deviations hold a long press."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from pose_steps_in_c import SiliconeInC
from test_rebaselining import life

from fmfts.bus.messages import ContactMessage
from fmfts.pad import Silicone
from fmfts.pipeline.creep import Creep
from fmfts.pose.silicone import TIMES_S
from fmfts_lab.bench.long_squeeze import BEGIN_S, RAMP_S, Squeeze, force_deviations, longest_contact_s, squeezed
from fmfts_simulation.finger import Touch
from fmfts_simulation.silicone import CREEP_PER_DECADE, MEASURED_S
from fmfts_simulation.silicone import Silicone as CreepingSilicone

SQUEEZE = Squeeze(Touch(2e-3, -1.5e-3, 4.0), 30.0)
HOLD = Squeeze(Touch(-3e-3, 2e-3, 1.0), 60.0)


@cache
def after_squeeze(creep_times: float, counted: bool) -> list[ContactMessage]:
    return squeezed(SQUEEZE, SQUEEZE.end_s + 4.0, "constant", 1, creep_times, turn=False, counted=counted)


@pytest.mark.parametrize("creep_times", [1.0, 2.0])
def test_recovering_pad_is_not_touched(creep_times: float) -> None:
    messages = after_squeeze(creep_times, counted=True)
    assert longest_contact_s(messages, SQUEEZE.end_s) < 1.0
    assert all(message.health == "ok" for message in messages[5:])


def test_silicone_recovery_is_a_false_touch_if_not_modelled() -> None:
    assert longest_contact_s(after_squeeze(1.0, counted=False), SQUEEZE.end_s) > 1.0


def test_force_deviation_includes_silicone_recovery() -> None:
    """It sinks by what 0.02 N would do, and more. Without a touch it publishes none, and a deviation that covers it."""
    later = [one for one in after_squeeze(1.0, counted=True) if one.t_sample_ns * 1e-9 > SQUEEZE.end_s + 1.0]
    mistaken = [one.force_n for one in after_squeeze(1.0, counted=False) if one.contact][-100:]
    forces = np.array([(one.force_n, one.force_sd_n) for one in later], dtype=float)
    assert max(mistaken) > 0.02
    assert (forces[:, 0] == 0.0).all()
    assert max(mistaken) < 2.0 * forces[:, 1].min()


@pytest.mark.long
@pytest.mark.parametrize("ambient", ["constant", "drifting"])
def test_ten_minutes_of_4_n_leave_no_touch(ambient: str) -> None:
    squeeze = Squeeze(SQUEEZE.touch, 600.0)
    messages = squeezed(squeeze, squeeze.end_s + 20.0, ambient, 2)
    assert longest_contact_s(messages, squeeze.end_s) < 1.0


def test_force_of_a_minute_s_hold_is_within_its_deviations() -> None:
    messages = squeezed(HOLD, HOLD.end_s, "constant", 1, turn=False)
    errors = np.abs(force_deviations(messages, HOLD.touch.force_n, BEGIN_S + RAMP_S, HOLD.end_s - RAMP_S))
    assert len(errors) > 0.95 * HOLD.seconds * 220.0
    assert np.mean(errors < 2.0) > 0.95


@pytest.mark.long
def test_recovery_is_not_learned_as_drift() -> None:
    """2 N for 100 s leave some ten micrometres, which go in minutes; the follower waits for them to go."""
    run = life(260.0, lambda time_s: Touch(0.0, 0.0, 2.0 * (10.0 < time_s < 110.0)), creeps=True)
    assert max(run.sizes_m) < 1e-6


def test_deviation_of_a_held_press_grows_and_decays_by_decades() -> None:
    follower, press = SiliconeInC(Silicone(0.02, 0.01), 0.1), np.array([0.0, 0.0, -1e-3, 0.0, 0.0])

    def height_sd(change: np.ndarray, seconds: float) -> float:
        for _ in range(round(seconds / 0.05)):
            follower.passed(0.05)
            spread = follower.update(change)
        return float(np.sqrt(spread[2, 2]))

    at_once, after_ten_s, after_minutes = (height_sd(press, seconds) for seconds in (0.05, 10.0, 200.0))
    assert 1e-3 * 0.02 < at_once < after_ten_s < after_minutes < 1e-3 * 0.06
    released, later = height_sd(0.0 * press, 1.0), height_sd(0.0 * press, 100.0)
    assert 0.5 * after_minutes < released < after_minutes
    assert later < 0.6 * released


def test_load_of_a_gap_is_the_larger_one() -> None:
    """Nobody saw when it ended: a squeeze that saturates the chips may have lasted to the last moment."""
    follower, press = SiliconeInC(Silicone(0.02), 0.1), np.array([0.0, 0.0, -1e-3, 0.0, 0.0])
    follower.passed(0.01)
    follower.update(press)
    follower.passed(1000.0)
    follower.update(0.0 * press)
    assert follower.crept[TIMES_S < 50.0, 2] == pytest.approx(-1e-3, rel=0.02)


def test_each_decade_of_loads_is_filtered_independently() -> None:
    """Loads that come and go, and gaps between frames. A filter of the first order, by the implicit step of Euler."""
    random, silicone = np.random.default_rng(1), Silicone(0.02, 0.01)
    follower, creep = SiliconeInC(silicone, 0.1), Creep(silicone, 0.1)
    change, before, filtered = np.zeros(5), np.zeros(5), np.zeros((4, 5))
    for _ in range(500):
        change = random.normal(size=5) * [1e-4, 1e-4, 1e-3, 0.05, 0.05] if random.random() < 0.2 else change
        elapsed_s = random.choice([0.005, 0.09, 0.5, 60.0])
        follower.passed(elapsed_s)
        held = before if elapsed_s > 0.1 and before @ before > change @ change else change
        for decade, time_s in enumerate((1.0, 10.0, 100.0, 1000.0)):
            filtered[decade] = (filtered[decade] + elapsed_s / time_s * held) / (1.0 + elapsed_s / time_s)
        before = change
        left = (1.25 * 0.02) ** 2 * sum(np.outer(one, one) for one in filtered)
        expected = (0.02**2 + 0.01**2) * np.outer(change, change) + left
        np.testing.assert_allclose(follower.update(change), expected, rtol=1e-9, atol=1e-24)
        np.testing.assert_allclose(creep.left_behind(change, elapsed_s), left, rtol=1e-9, atol=1e-24)


def test_simulated_silicone_creeps_each_decade_and_recovers() -> None:
    silicone, way = CreepingSilicone(1, hysteresis=0.0), np.zeros((1, 1, 5))
    way[0, 0, 2] = -1e-3
    silicone.moved(np.array([[0.0]]), 0.0 * way)
    # The movement is even between two samples: a step is one that takes a millisecond.
    moved = [float(silicone.moved(np.array([[now]]), way)[0, 0, 2]) for now in (1e-3, MEASURED_S, 10.0, 100.0, 1000.0)]
    assert moved[1] == pytest.approx(-1e-3, rel=2e-3)
    assert np.diff(moved[2:]) / -1e-3 == pytest.approx(CREEP_PER_DECADE, rel=0.15)
    back = [float(silicone.moved(np.array([[now]]), 0.0 * way)[0, 0, 2]) for now in (1000.001, 1001.0, 3000.0)]
    assert -1e-3 * 0.1 < back[0] < back[1] < back[2] < 0.0
    assert back[2] > -1e-3 * 0.01
