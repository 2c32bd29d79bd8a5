"""A few of the drills of `python -m fmfts.bench faults`: frames of free-running chips through the whole pipeline."""

from __future__ import annotations

import json

import pytest

from fmfts.bench.drills import Ambient, field_faults, sensor_faults
from fmfts.bench.faults import Outcome, Well, as_json, drilled, tapped


@pytest.mark.parametrize("ambient", ["constant", "drifting"])
def test_broken_axis_is_never_believed_for_longer_than_half_a_second(ambient: Ambient) -> None:
    outcomes = drilled(sensor_faults((1,), (0,)), (1,), ambients=(ambient,), touches=("pressed",))
    assert {outcome.kind for outcome in outcomes} >= {"invalid", "saturated", "stuck", "offset 100 mG", "gain 5 %"}
    for outcome in outcomes:
        assert outcome.wrong_late == 0, outcome.line
        if outcome.kind in ("invalid", "saturated", "offset 100 mG"):
            assert len(outcome.detected_ms) == outcome.drills, outcome.line
            assert outcome.named >= 0.95 * outcome.alarmed, outcome.line
        if outcome.kind == "stuck":
            # Fifteen samples of one value, at 220 Hz ± 3 %, and the alignment's one.
            assert max(outcome.detected_ms) < 90.0, outcome.line


def test_foreign_field_is_never_believed_for_longer_than_half_a_second() -> None:
    kinds = ("neighbour 30 mm, moving", "neighbour 60 mm, fixed", "field step 100 mG")
    faults = [fault for fault in field_faults() if fault.kind in kinds]
    outcomes = drilled(faults, (1,), ambients=("constant",), touches=("rest",))
    for outcome in outcomes:
        assert outcome.wrong_late == 0, outcome.line
        assert outcome.health["degraded"] == 0, outcome.line
        assert outcome.health["disturbed"] > 0.9 * outcome.frames, outcome.line


@pytest.mark.parametrize("ambient", ["constant", "drifting"])
def test_magnet_that_returns_under_a_finger_is_right_at_once(ambient: Ambient) -> None:
    """Chips that run free sample on both sides of its return."""
    faults = [fault for fault in field_faults() if fault.kind == "magnet lost, returned"]
    (outcome,) = drilled(faults, (2,), ambients=(ambient,), touches=("pressed",))
    assert (outcome.wrong_early, outcome.wrong_late) == (0, 0), outcome.line
    assert outcome.health["ok"] > 0.45 * outcome.frames, outcome.line


def test_taps_on_chips_that_run_free_are_no_alarm() -> None:
    well = tapped("drifting", (1,), 5.0)
    assert (well.alarms, well.wrong) == (0, 0), well.line


def test_facts_of_the_drills_are_json() -> None:
    outcome = Outcome("offset 30 mG", "drifting", "rest", worst=float("inf"))
    outcome.health["ok"] += 3
    facts = json.loads(as_json([outcome], [Well("constant", frames=10)]))
    assert facts["faults"][0]["health"] == {"ok": 3}
    assert facts["faults"][0]["worst"] is None
    assert facts["healthy"][0]["frames"] == 10
