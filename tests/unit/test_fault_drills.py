"""A few of the drills of `python -m fmfts_lab.bench faults`: free-running chips through the whole pipeline."""

from __future__ import annotations

import json

import numpy as np
import pytest
from bus_messages import contact_message

from fmfts.pipeline.configured import load_contact_model
from fmfts_lab.bench.drills import RATE_HZ, Ambient, pad_config, record
from fmfts_lab.bench.fault_kinds import field_faults, sensor_faults
from fmfts_lab.bench.faults import Healthy, Outcome, as_json, drilled
from fmfts_lab.bench.tapped import ManyFrames, Well, tapped, tapping
from fmfts_lab.bench.truth import WRONG_DEVIATIONS
from fmfts_simulation.source import Simulated


@pytest.mark.parametrize("ambient", [pytest.param("constant", marks=pytest.mark.long), "drifting"])
def test_broken_axis_is_accepted_for_at_most_half_a_second(ambient: Ambient) -> None:
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


def test_foreign_field_is_accepted_for_at_most_half_a_second() -> None:
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


def test_swapped_wires_make_no_ok_frame() -> None:
    """On pad 2 three sensors agree at once with a magnet pressed deep, beyond the model's range."""
    drill = Healthy("drifting", "rest", 2, load_contact_model(pad_config("drifting", 2)))
    (fault,) = [fault for fault in field_faults() if fault.kind == "wires 2 and 3 swapped"]
    pipeline, frames = drill.pipeline(), drill.frames_with(fault)
    messages = [pipeline.process(frame) for frame in frames[drill.begin : drill.end]]
    told = [message for message in messages if message.pose is not None]
    assert {message.health for message in told} == {"degraded"}
    assert "the field jumped between two samples by more than a finger can change it" in told[0].reason
    assert not (drill.truth.all_deviations(messages) > WRONG_DEVIATIONS)[len(told) :].any()


def test_taps_on_free_running_chips_raise_no_alarm() -> None:
    well = tapped("drifting", (1,), 5.0)
    assert (well.alarms, well.wrong) == (0, 0), well.line


@pytest.mark.parametrize("ambient", ["constant", "drifting"])
def test_many_frames_at_once_are_those_of_as_many_polls(ambient: Ambient) -> None:
    polled = record(Simulated(pad_config(ambient, 1)), tapping, 6.0)
    source = ManyFrames(pad_config(ambient, 1))
    source.finger = tapping
    at_once = [frame for batch in source.batches(round(6.0 * RATE_HZ)) for frame in batch]
    for one, other in zip(polled, at_once, strict=True):
        assert one.packed == other.packed
        assert (one.sequence, one.device_time_us, one.host_time_ns, one.temperature_c) == (
            *(other.sequence, other.device_time_us, other.host_time_ns, other.temperature_c),
        )


def test_alarm_is_a_run_of_messages_that_are_not_ok() -> None:
    well = Well("constant")
    ok, lost = contact_message(health="ok"), contact_message(health="lost")
    well.saw([lost, lost, ok, lost], np.zeros(4), was_ok=True)
    well.saw([lost, ok, ok, ok], np.zeros(4), was_ok=False)
    assert (well.frames, well.not_ok, well.alarms) == (8, 4, 2)


def test_facts_of_the_drills_are_json() -> None:
    outcome = Outcome("offset 30 mG", "drifting", "rest", worst=float("inf"))
    outcome.health["ok"] += 3
    facts = json.loads(as_json([outcome], [Well("constant", frames=10)]))
    assert facts["faults"][0]["health"] == {"ok": 3}
    assert facts["faults"][0]["worst"] is None
    assert facts["healthy"][0]["frames"] == 10


def test_ending_field_is_followed_until_the_pad_is_ok() -> None:
    """30 mG for 1.2 s in a constant scene, and then none."""
    step = [fault for fault in field_faults() if fault.kind == "field step 30 mG"]
    (outcome,) = drilled(step, [1], ["constant"], ["rest"])
    assert outcome.health["ok"] < 0.2 * outcome.frames
    # A second of healthy frames since the field was seen to move, after the mean residuals have forgotten it.
    assert len(outcome.back_ms) == 1
    assert 1000.0 <= outcome.back_ms[0] < 2000.0
