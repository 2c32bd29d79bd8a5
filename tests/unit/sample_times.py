"""Judges the times of samples: chips sense a field that encodes the time, so each sample shows when it was measured.

The field is a triangle of known slope, so a count gives two instants in each period; the nearest one counts. Emulated
chips sense the mean over their measurement (tests/emulator/memsic_film.py), which of a straight line is its middle.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from emulated_bus import Clock, emulated_pad, patched, run
from test_chip_drivers import chip_of

from fmfts.sensor.chips import CHIPS

PERIOD_S, PEAK_GAUSS = 2.0, 3.5
SLOPE = 4.0 * PEAK_GAUSS / PERIOD_S  # gauss a second
SAME_SAMPLE_S = 0.5e-3  # no measurement is shorter


@dataclass
class Judged:
    """samples: those that were reported as new, and are far enough from a peak to be judged."""

    frames: int = 0
    samples: int = 0
    repeated: int = 0
    worst_s: float = 0.0
    fresh_share: list[float] = field(default_factory=list)

    def __str__(self) -> str:
        return (
            f"{self.frames} frames, {self.samples} samples judged: {self.repeated} old ones called new, worst error of "
            f"a time {self.worst_s * 1e3:.3f} ms, {min(self.fresh_share):.2%} of frames with a new sample of each chip"
        )


def triangle(time_s: float) -> tuple[float, float, float]:
    phase = time_s / PERIOD_S % 1.0
    value = 4.0 * abs(phase - 0.5) - 1.0
    return PEAK_GAUSS * value, 0.3, 0.2


def judged(clock: Clock, kind: str, rate_hz: int, trigger: int, frames: int, polls: int = 1) -> Judged:
    """The pad's frames at this rate. polls: of the reader in each frame."""
    chips = [
        chip_of(clock, kind, clock_error=error, seed=number) for number, error in enumerate((-0.04, 0.0, 0.04, 0.02))
    ]
    for one in chips:
        one.field_at = triangle
    pad, _ = emulated_pad(clock, kind, chips, rate_hz=rate_hz, trigger=trigger)
    run(pad, clock, 0.1, rate_hz)
    result, before = Judged(), [0.0] * len(chips)
    fresh = np.zeros(len(chips))
    for _ in range(frames):
        for sample in run(pad, clock, 0.999 / rate_hz, rate_hz * polls)[-1:]:
            result.frames += 1
            for number in range(len(chips)):
                if sample.fresh >> number & 1:
                    fresh[number] += 1
                    told_s = (sample.time_us - int(sample.age_us[number])) * 1e-6
                    before[number] = _judge(result, kind, sample.counts[number], told_s, before[number])
    result.fresh_share = [float(each) for each in fresh / frames]
    return result


def _judge(result: Judged, kind: str, counts: Any, told_s: float, before_s: float) -> float:
    """Returns when the sample was measured."""
    gauss = float(counts[0]) * CHIPS[kind].step_t[0, 0] * 1e4
    if abs(gauss) > 0.9 * PEAK_GAUSS:
        return before_s
    quarter_s = (gauss / PEAK_GAUSS + 1.0) / 4.0 * PERIOD_S
    instants = [round(told_s / PERIOD_S - 0.5) * PERIOD_S + 0.5 * PERIOD_S + side * quarter_s for side in (-1.0, 1.0)]
    measured_s = min(instants, key=lambda each: abs(each - told_s))
    result.samples += 1
    result.worst_s = max(result.worst_s, float(abs(measured_s - told_s)))
    result.repeated += bool(abs(measured_s - before_s) < SAME_SAMPLE_S)
    return measured_s


def main(frames: int) -> None:
    """`make sample-times`: whether a sample is new, and when it was measured."""
    for kind in ("mmc5983ma", "mmc5603nj"):
        for trigger, rate_hz in (("free", 220), ("simultaneous", 220)):
            clock = Clock()
            with patched(clock):
                print(
                    f"{kind}, {trigger}, {rate_hz} Hz: {judged(clock, kind, rate_hz, int(trigger != 'free'), frames)}"
                )


if __name__ == "__main__":
    main(int(sys.argv[1]))
