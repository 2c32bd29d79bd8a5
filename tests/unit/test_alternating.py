"""A field that alternates during a baseline's recording, like a room's mains, against NumPy's own sine."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmfts.baseline.alternating import Alternation, alternation, warnings_of
from fmfts.baseline.recording import summarise
from fmfts.baseline.request import BaselineRequest
from fmfts.pad import Pad, Tolerance
from fmfts.sensor import Frame
from fmfts.sensor.chips import NOISE_T
from fmfts.sensor.frame import AGE_UNKNOWN_US
from fmfts.view.facts import fact_lines

SENSORS, SECONDS = 4, 3.0
# The direction of a cable's field, in the axes of chips that are turned by right angles.
DIRECTIONS = np.array([[0.6, 0.0, 0.8], [0.0, -0.6, 0.8], [-0.6, 0.0, 0.8], [0.8, 0.6, 0.0]])


def _recorded(hz: float, amplitude_t: float, rate_hz: float = 220.0, seed: int = 0) -> list[Frame]:
    """Frames of chips on their own clocks, in a field that alternates."""
    random = np.random.default_rng(seed)
    age_s = np.append(0.0, random.uniform(0.0, 0.9 / rate_hz, SENSORS - 1))
    time_s = np.arange(1, round(SECONDS * rate_hz) + 1)[:, None] / rate_hz
    wave = amplitude_t * np.sin(2.0 * np.pi * hz * (time_s - age_s) + random.uniform(0.0, 2.0 * np.pi))
    field = 3e-5 + wave[:, :, None] * DIRECTIONS + random.normal(0.0, NOISE_T, (len(time_s), SENSORS, 3))
    counts = np.rint(field / 1e-4 * 660).astype(np.int16)
    age_us, yes = np.rint(age_s * 1e6).astype(np.uint16), np.ones(SENSORS, bool)
    return [
        Frame(0, step, round(now * 1e6), round(now * 1e9), 3, counts[step], age_us, yes, yes, 25.0)
        for step, now in enumerate(time_s[:, 0])
    ]


def _found(hz: float, amplitude_t: float, rate_hz: float = 220.0) -> Alternation:
    found = alternation(_recorded(hz, amplitude_t, rate_hz))
    assert found is not None
    return found


@pytest.mark.parametrize("amplitude_t", [2e-7, 2e-6, 5e-6])
@pytest.mark.parametrize("hz", [50.0, 60.0])
@pytest.mark.parametrize("rate_hz", [75.0, 160.0, 220.0])
def test_mains_is_named_with_its_frequency_and_amplitude(hz: float, amplitude_t: float, rate_hz: float) -> None:
    found = _found(hz, amplitude_t, rate_hz)
    assert f"alternates at {hz:g} Hz, as of mains" in found.sentence
    # A quarter of a resolution off the grid an amplitude is a tenth too small; noise leaves 0.01 µT of the mean's.
    assert found.size_t == pytest.approx(amplitude_t, rel=0.12, abs=4e-8)


@pytest.mark.parametrize("hz", [7.3, 33.0, 91.7])
def test_motor_is_named_with_its_frequency(hz: float) -> None:
    found = _found(hz, 1e-6)
    assert found.frequency_hz == pytest.approx(hz, abs=0.25 / SECONDS + 1e-9)
    assert f"alternates at {found.frequency_hz:.1f} Hz: " in found.sentence


def test_noise_alone_is_no_alternation() -> None:
    """Expected of these: 4e-5."""
    assert [alternation(_recorded(50.0, 0.0, seed=seed)) for seed in range(40)] == [None] * 40


def test_field_that_repeats_one_count_does_not_alternate() -> None:
    still = [replace(frame, counts=np.full((SENSORS, 3), 20, np.int16)) for frame in _recorded(50.0, 0.0)]
    assert alternation(still) is None
    assert warnings_of(still) == []


def test_strong_field_on_all_axes_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "DIRECTIONS", np.full((SENSORS, 3), np.sqrt(1.0 / 3.0)))
    for hz in np.arange(2.0, 109.0, 1.7):
        assert _found(hz, 5e-5).size_t == pytest.approx(5e-5, rel=0.12)


def test_samples_without_time_show_no_alternation() -> None:
    unknown = np.full(SENSORS, AGE_UNKNOWN_US, np.uint16)
    frames = [replace(frame, age_us=unknown) for frame in _recorded(50.0, 2e-6)]
    assert alternation(frames) is None
    summarise(frames)


def test_samples_that_are_not_new_are_left_out() -> None:
    stale = np.zeros(SENSORS, bool)
    frames = [
        frame if number % 2 else replace(frame, fresh=stale, counts=frame.counts + np.int16(300 * (number % 4 - 1)))
        for number, frame in enumerate(_recorded(50.0, 0.0))
    ]
    assert alternation(frames) is None


def test_spectral_line_far_below_noise_is_not_reported() -> None:
    assert alternation(_recorded(50.0, 0.4 * NOISE_T)) is None


def _warned(frames: list[Frame], pad: Pad) -> list[str]:
    """The warnings that `baseline --bare` prints beside its figures."""
    request = BaselineRequest(pad, Tolerance(1e-4, 1e-4, 0.02, 0.005, 0.05), bare=True, replaced=False)
    facts = request.record(frames, None).facts(pad)
    warnings: list[str] = facts["warnings"]
    assert all(f"beware: {warning}" in fact_lines(facts) for warning in warnings)
    assert warnings or not any(line.startswith("beware") for line in fact_lines(facts))
    return warnings


def test_baseline_recording_reports_alternating_field(
    pad: Pad, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert _warned(_recorded(50.0, 0.0), pad) == []
    (alternates,) = _warned(_recorded(60.0, 2e-6), pad)
    assert "alternates at 60 Hz, as of mains" in alternates
    noisy = _recorded(50.0, 0.0)
    random = np.random.default_rng(9)
    for frame in noisy:
        frame.counts[2] += np.rint(random.normal(0.0, 4.0 * NOISE_T, 3) / 1e-4 * 660).astype(np.int16)
    (loud,) = _warned(noisy, pad)
    assert re.match(r"sensor 3 has 0\.8\d µT of noise, where an HMC5983 has 0\.20 µT: look for", loud)


@pytest.mark.parametrize(
    ("share", "seen"),
    [(0.0, "exactly 0"), (0.05, "at most 2.6"), (0.15, None), (1.0, None)],
)
def test_bare_field_far_below_earths_is_reported(
    pad: Pad, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float, seen: str | None
) -> None:
    """The recorded field has 52 µT. Chips with zeros of their own hide a missing field, so all must be weak."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    frames = _recorded(50.0, 0.0)
    still = [replace(frame, counts=np.rint(share * frame.counts).astype(np.int16)) for frame in frames]
    warnings = _warned(still, pad)
    if seen is None:
        assert warnings == []
    else:
        (weak,) = warnings
        assert weak.startswith(f"each sensor sees {seen}")
        assert "In a magnetic shield" in weak
        assert "`fmfts-daemon probe`" in weak
    for frame in still:
        frame.counts[3] = 300
    assert _warned(still, pad) == [], "one sensor sees a field"


@pytest.mark.parametrize("hz", [7.3, 50.0])
def test_alternating_field_counts_as_noise(hz: float) -> None:
    """Differences of samples 4.5 ms apart show a tenth of 7 Hz. All axes err together: each includes the others'
    errors."""
    summary = summarise(_recorded(hz, 2e-6))
    rms = 2e-6 * np.abs(DIRECTIONS) / np.sqrt(2.0)
    expected = np.sqrt(NOISE_T**2 + rms * rms.sum())
    # 3 % from 660 values, and 2 % from rounding to counts. An axis without any shows the effect of noise on this many
    # samples.
    chance = np.sqrt(rms.sum() * NOISE_T * np.sqrt(2.0 / 660.0))
    assert (np.abs(summary.noise_t - expected) <= 0.1 * expected + np.where(rms == 0.0, 2.0 * chance, 0.0)).all()
    # Whatever the phases of the sensors, independent noise of this size is more than what alternates. Between two
    # searched frequencies up to a tenth of the amplitude is missed.
    together = np.outer(rms.ravel(), rms.ravel())
    assert np.linalg.eigvalsh(np.diag(1.2 * np.square(summary.noise_t).ravel()) - together).min() > 0.0
