"""Offsets of chips that drift three times as much as is assumed: the pad stays published, and a real fault is found.

30 nT/K instead of 10: no data sheet says what set and reset pulses leave. A small fault of a warm pad looks the same.
"""

from __future__ import annotations

import time
from dataclasses import replace

import pytest
from test_pipeline import Bench, config_of, frames_of

from fmfts.bus.messages import ContactMessage
from fmfts.pipeline.configured import load_contact_model
from fmfts.sensor.frame import Frame, WireFrame
from fmfts_lab.bench.silicone import Effect, RealPad, RealTruth, baseline_of, messages_of
from fmfts_lab.bench.tapped import without_baseline
from fmfts_lab.bench.truth import WRONG_DEVIATIONS
from fmfts_lab.bench.warming import WarmingPad, batches
from fmfts_simulation.finger import no_finger

FAULT_COUNTS = 300  # of one axis: 20 µT and more
COUNT_UT = 100.0 / 660.0  # of these chips at ±2.5 G: 660 counts a gauss


class Warm:
    """An untouched pad that warms by 10 K within some seconds, in a constant field."""

    def __init__(self, seed: int, drift_times: float, seconds: float) -> None:
        effect = Effect("offset drift", ("offset_drift",))
        config = effect.config("constant", seed)
        self.pipeline = without_baseline(config, load_contact_model(config))
        self.pipeline.use(baseline_of(config, RealPad(config), turn=False))
        source = WarmingPad(config)
        source.drifts(drift_times)
        source.most_k, source.seconds, source.finger = 10.0, seconds, no_finger
        self.truth = RealTruth(source, config, no_finger)
        self._batches = batches(source, 60.0)

    def run(self, seconds: int, off_counts: int = 0) -> list[ContactMessage]:
        """off_counts: of one axis of the third sensor."""
        told: list[ContactMessage] = []
        for _ in range(seconds):
            told += messages_of(self.pipeline, (_broken(frame, off_counts) for frame in next(self._batches)))
        return told


def _broken(frame: WireFrame, off_counts: int) -> Frame | WireFrame:
    if not off_counts:
        return frame
    counts = frame.counts.copy()
    counts[2, 0] += off_counts
    whole = {name: getattr(frame, name) for name in Frame.__dataclass_fields__}
    return replace(Frame(**whole), counts=counts)


@pytest.mark.parametrize("seed", [1, 11])
def test_pad_whose_offsets_drift_further_stays_published_and_untouched(seed: int) -> None:
    """Before, these two were down for 16 and 25 % of the time, and the first told 130 touches."""
    pad = Warm(seed, drift_times=3.0, seconds=20.0)
    told = pad.run(2)
    assert pad.pipeline.further_drift == ""
    told += pad.run(20)
    assert sum(one.health not in ("ok", "degraded") for one in told) < 1e-3 * len(told)
    assert not any(one.contact for one in told)
    assert "10 K warmer" in pad.pipeline.further_drift
    assert "4 times as far" in pad.pipeline.further_drift


def test_offset_that_jumps_on_a_warm_pad_is_named() -> None:
    pad = Warm(1, drift_times=3.0, seconds=20.0)
    pad.run(18)
    after = pad.run(4, FAULT_COUNTS)[-440:]
    assert sum("sensor 3" in (one.reason or "") for one in after) > 0.95 * len(after)
    assert {one.health for one in after} == {"degraded"}


@pytest.mark.parametrize("field_ut", [0.3, 0.5, 1.0, 2.0, 3.0])
def test_small_fault_of_warm_pad_widens_deviations_until_it_ends(field_ut: float) -> None:
    """Up to 0.5 µT no mean shows it. More looks like drift, is counted, and forgotten within 30 s after its end."""
    pad = Warm(1, drift_times=1.0, seconds=1.0)
    pad.run(4)
    told = pad.run(4, round(field_ut / COUNT_UT))
    assert (pad.truth.all_deviations(told) < WRONG_DEVIATIONS).all()
    assert not any(one.contact for one in told)
    assert bool(pad.pipeline.further_drift) == (field_ut >= 1.0)
    told = pad.run(30)
    assert pad.pipeline.further_drift == ""
    assert (pad.truth.all_deviations(told) < WRONG_DEVIATIONS).all()
    assert {one.health for one in told[220:]} == {"ok"}


def test_larger_fault_of_warm_pad_is_named() -> None:
    pad = Warm(1, drift_times=1.0, seconds=1.0)
    pad.run(4)
    told = pad.run(4, round(4.0 / COUNT_UT))[220:]
    assert sum("sensor 3" in (one.reason or "") for one in told) > 0.95 * len(told)


def test_status_of_healthy_pad_says_that_its_offsets_drift_further() -> None:
    with Bench(config_of()) as bench:
        pad = Warm(1, drift_times=3.0, seconds=20.0)
        pad.run(22)
        for frame in frames_of(config_of(), no_finger, 0.05):
            bench.channel.frame(replace(frame, host_time_ns=time.monotonic_ns()))
        assert bench.channel.status(time.monotonic_ns()).reason == ""
        bench.channel.pipeline = pad.pipeline
        status = bench.channel.status(time.monotonic_ns())
    assert status.health == "ok"
    assert status.reason == pad.pipeline.further_drift != ""
