"""What a person is told while turning the robot or pressing the pad, and when the recording ends early."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from fmfts.baseline.coverage import Coverage, PressCoverage, TurnCoverage
from fmfts.baseline.job import BaselineJob
from fmfts.baseline.request import BaselineRequest
from fmfts.config import PadConfig, SimulatedSource
from fmfts_simulation.baseline import hold_still, simulated_baseline
from fmfts_simulation.finger import Finger, Touch, no_finger
from fmfts_simulation.source import Simulated

CONFIG = PadConfig(name="left", source=SimulatedSource())
PERIOD_NS = round(1e9 / 220)
PRESS_S = 0.5


def still() -> Simulated:
    source = Simulated(CONFIG)
    hold_still(source, mounted=True)
    source.finger = no_finger
    return source


def hints(source: Simulated, coverage: Coverage, seconds: float) -> tuple[list[str], float]:
    """The hints in order, each once, and the time at which there was enough; infinite if there never was."""
    said: list[str] = []
    for step in range(round(seconds * 220)):
        for frame in source.poll(step * PERIOD_NS):
            coverage.take(frame)
        if not said or coverage.hint != said[-1]:
            said.append(coverage.hint)
        if coverage.enough:
            return said, step / 220
    return said, np.inf


def pressing(place: Callable[[int], tuple[float, float]], force: Callable[[int], float]) -> Finger:
    """One press each PRESS_S, after half a second without one."""

    def finger(time_s: float) -> Touch:
        number, phase = divmod(time_s - 0.5, PRESS_S)
        if number < 0 or phase > 0.7 * PRESS_S:
            return Touch(0.0, 0.0, 0.0)
        return Touch(*place(int(number)), force(int(number)) * np.sin(np.pi * phase / (0.7 * PRESS_S)))

    return finger


def all_over(number: int) -> tuple[float, float]:
    x_m, y_m = [(5e-3, 5e-3), (5e-3, -5e-3), (-5e-3, 5e-3), (-5e-3, -5e-3)][number % 4]
    return x_m, y_m


def test_turning_about_all_axes_ends_before_the_twenty_seconds() -> None:
    source = still()
    source.tumbling = True
    said, enough_s = hints(source, TurnCoverage(CONFIG.pad()), 20.0)
    assert said[0].startswith("start now: turn")
    assert any(hint.startswith("turn about another axis, across the first (the pad's x): ") for hint in said)
    assert 5.0 < enough_s < 15.0


def test_standing_robot_never_completes_a_turn() -> None:
    said, enough_s = hints(still(), TurnCoverage(CONFIG.pad()), 10.0)
    assert said[-1].startswith("the field hardly turns yet")
    assert enough_s == np.inf


def test_turn_about_one_axis_reports_what_is_missing() -> None:
    source = still()
    source.turning_rad_per_s = 1.0  # about an axis that is not one of the pad's
    said, enough_s = hints(source, TurnCoverage(CONFIG.pad()), 15.0)
    assert said[-1] == "turn about another axis, across the first: 0 % of what it needs"
    assert enough_s == np.inf


def test_thirty_presses_all_over_the_pad_are_enough() -> None:
    source = still()
    source.finger = pressing(all_over, lambda number: 0.4 + 0.3 * (number % 5))
    said, enough_s = hints(source, PressCoverage(CONFIG.pad()), 40.0)
    assert said[:2] == [
        "do not touch the pad yet",
        "start now: press some 30 times, each for a moment, all over the pad",
    ]
    assert enough_s == pytest.approx(0.5 + 30 * PRESS_S, abs=2 * PRESS_S)


@pytest.mark.parametrize(
    ("place", "force_n", "missing"),
    [
        (
            lambda number: (5e-3, 5e-3),
            lambda number: 0.4 + 0.3 * (number % 5),
            "4 presses in each of 3 of 4 parts of the pad",
        ),
        (all_over, lambda number: 1.0, "lighter and firmer ones"),
    ],
)
def test_similar_presses_report_what_is_missing(
    place: Callable[[int], tuple[float, float]], force_n: Callable[[int], float], missing: str
) -> None:
    source = still()
    source.finger = pressing(place, force_n)
    said, enough_s = hints(source, PressCoverage(CONFIG.pad()), 20.0)
    assert missing in said[-1]
    assert enough_s == np.inf


@pytest.mark.parametrize("duration_s", [None, 12.0])
def test_recording_ends_early_unless_a_duration_is_given(
    duration_s: float | None, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
    source = still()
    source.tumbling = True
    with ThreadPoolExecutor(max_workers=1) as executor:
        request = BaselineRequest(CONFIG.pad(), CONFIG.tolerance.si(), False, False, duration_s, turn=True)
        job = BaselineJob(request, simulated_baseline(CONFIG), source, executor)
        step = 0
        while job._result is None and step < 25 * 220:
            for frame in source.poll(step * PERIOD_NS):
                job.take(frame)
            assert job.hint or duration_s is not None
            step += 1
        ended_s = step / 220
        until = time.monotonic() + 60.0
        while (facts := job.facts()) is None and time.monotonic() < until:
            time.sleep(0.01)
    assert facts is not None
    assert facts["now_gain_sd"] < facts["was_gain_sd"]
    assert ended_s == pytest.approx(12.0, abs=0.5) if duration_s else ended_s < 12.0
