"""The hands that hold a simulated pad for its baselines: each recording is good, and the pad is left as it was."""

from __future__ import annotations

import numpy as np
import pytest

from fmfts.baseline import Baseline, accuracy
from fmfts.baseline.coverage import PressCoverage, TurnCoverage
from fmfts.baseline.request import DURATION_S, REFINE_S, TURN_S, BaselineRequest
from fmfts.config import PadConfig, SimulatedSource
from fmfts.sensor import Frame
from fmfts.sensor.source import UNSETTLED_FRAMES
from fmfts_simulation.finger import no_finger, steady_finger
from fmfts_simulation.hands import Hands
from fmfts_simulation.source import Simulated

CONFIG = PadConfig(name="left", source=SimulatedSource())  # pressed by the script on a robot that turns
PERIOD_NS = round(1e9 / 220)
COUNT_T = 1e-4 / 660  # one count of the chip at 2.5 gauss


def request(kind: str) -> BaselineRequest:
    return BaselineRequest(
        CONFIG.pad(), CONFIG.tolerance.si(), kind == "bare", False, turn=kind == "turn", refine=kind == "refine"
    )


def frames(source: Simulated, seconds: float) -> list[Frame]:
    begun = round(source.time_s * 220)
    return [
        frame
        for step in range(round(seconds * 220))
        for frame in source.poll((begun + step) * PERIOD_NS + PERIOD_NS // 2)
    ]


@pytest.mark.long
def test_turn_and_refine_improve_the_baseline_of_each_recording() -> None:
    source = Simulated(CONFIG)
    frames(source, 5.0)  # the script is already pressing
    baseline: Baseline | None = None
    known: list[dict[str, float]] = []
    for kind, seconds in (("bare", DURATION_S), ("rest", DURATION_S), ("turn", 14.0), ("refine", 20.0)):
        hands = Hands(source, bare=kind == "bare", turn=kind == "turn", refine=kind == "refine")
        frames(source, UNSETTLED_FRAMES / 220)
        baseline, mounting = request(kind).make(frames(source, seconds), baseline)
        hands.let_go()
        known.append(accuracy(mounting, CONFIG.pad()))
    _, rest, turned, refined = known
    assert turned["gain_sd"] < 0.8 * rest["gain_sd"]
    assert refined["sensor_place_sd_m"] < turned["sensor_place_sd_m"]
    assert refined["press_1n_force_sd_n"] < rest["press_1n_force_sd_n"]


@pytest.mark.long
@pytest.mark.parametrize("after_s", [0.0, 6.0, 13.0])
def test_turn_and_presses_suffice_at_any_start(after_s: float) -> None:
    source = Simulated(CONFIG)
    source.poll(0)
    source.poll(round(after_s * 1e9))
    for coverage, seconds in ((TurnCoverage(CONFIG.pad()), TURN_S), (PressCoverage(CONFIG.pad()), REFINE_S)):
        turns = isinstance(coverage, TurnCoverage)
        hands = Hands(source, bare=False, turn=turns, refine=not turns)
        for frame in frames(source, seconds):
            coverage.take(frame)
        hands.let_go()
        assert coverage.enough, coverage.hint


@pytest.mark.parametrize("kind", ["bare", "rest", "turn", "refine"])
def test_pad_state_is_restored(kind: str) -> None:
    source = Simulated(CONFIG)
    source.finger = finger = steady_finger(2e-3, 1e-3, 1.0)
    source.turning_rad_per_s = 0.3
    source.poll(0)
    hands = Hands(source, bare=kind == "bare", turn=kind == "turn", refine=kind == "refine")
    assert source.mounted == (kind != "bare")
    assert source.tumbling == (kind == "turn")
    assert (source.finger(source.time_s + 0.7).force_n > 0.0) == (kind == "refine")
    hands.let_go()
    assert (source.mounted, source.tumbling, source.turning_rad_per_s) == (True, False, 0.3)
    assert source.finger is finger


@pytest.mark.parametrize("kind", ["rest", "refine"])
def test_robot_goes_on_turning_from_where_it_stood(kind: str) -> None:
    """A jump of its field would be `disturbed` for a second after every baseline."""
    source = Simulated(CONFIG, noise_t=0.0)
    source.finger, source.turning_rad_per_s = no_finger, 0.3
    source.poll(0)
    frames(source, 5.0)
    hands = Hands(source, bare=False, turn=False, refine=kind == "refine")
    stood = frames(source, 0.5)[-1]
    hands.let_go()
    source.finger = no_finger
    turning = frames(source, 0.5)
    moved_t = np.abs(np.diff([each.field_t for each in (stood, *turning)], axis=0)).max(axis=(1, 2))
    step_t = 0.3 / 220 * 60e-6  # change in a frame of the Earth's field, which has at most sixty microtesla
    assert moved_t.max() < step_t + COUNT_T
    assert np.abs(turning[-1].field_t - stood.field_t).max() > 20 * step_t, "it does turn"
