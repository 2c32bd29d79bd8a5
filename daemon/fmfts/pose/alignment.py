"""Samples of chips that run free, brought to one instant.

Each chip converts on its own clock, so the samples of a frame are up to one period (4.5 ms) apart; a tap moves the
field further than its noise in that time. The newest instant that every chip has passed lies between two samples of
each: interpolating to it adds no noise and leaves out only the motion's curvature, which goes into the deviation.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import log, square
from fmfts.arithmetic.matrix import root_of_squares
from fmfts.arithmetic.series import erf

Array = NDArray[np.float64]
Times = NDArray[np.int64]

# A chip that is this many periods behind the others has stopped: it must not hold them back.
STOPPED_PERIODS = 2.5
# Runs of one value that a healthy axis's noise makes: once in ten hours on a pad of twelve axes at 220 Hz.
FALSE_STANDSTILL = 1e-8
# Half a gauss off the line of the two samples before: a tap of 1 N in 50 ms bends by a tenth of that.
JUMP_T = 5e-5


@dataclass(frozen=True, slots=True)
class Aligned:
    """field_t (N, 3) at `time_us`, NaN where a sensor has nothing to say.

    noise_share (N, 1): its noise over that of one sample (a mean has less). bend_t (N, 3): what curvature may add.
    repeats (N, 3): how many new samples in a row had the value of the one before.
    """

    field_t: Array
    noise_share: Array
    bend_t: Array
    time_us: int
    repeats: NDArray[np.int64]


@dataclass(slots=True)
class AlignmentMemory:
    """field_t (3, N, 3) and time_us (3, N): the three newest samples of each sensor, newest first; repeats (N, 3)."""

    field_t: Array
    time_us: Times
    repeats: NDArray[np.int64]


class Alignment:
    """The last three samples of each of `count` sensors."""

    def __init__(self, count: int, period_us: float) -> None:
        self.memory = AlignmentMemory(
            np.full((3, count, 3), np.nan), np.zeros((3, count), dtype=np.int64), np.zeros((count, 3), dtype=np.int64)
        )
        self.stopped_us = STOPPED_PERIODS * period_us

    def push(self, field_t: Array, time_us: Times, fresh: NDArray[np.bool_]) -> Aligned:
        """Take the newest field (N, 3) with the time of each sensor's sample (N,); only `fresh` ones are new."""
        memory = self.memory
        if time_us.max() < memory.time_us[0].max() - self.stopped_us:
            # The board was reset, and its time with it.
            memory.field_t[:], memory.time_us[:] = np.nan, 0
        if fresh.all():
            memory.field_t[2], memory.field_t[1], memory.field_t[0] = memory.field_t[1], memory.field_t[0], field_t
            memory.time_us[2], memory.time_us[1], memory.time_us[0] = memory.time_us[1], memory.time_us[0], time_us
            memory.repeats = np.where(memory.field_t[0] == memory.field_t[1], memory.repeats + 1, 0)
        elif fresh.any():
            memory.field_t[1:, fresh] = memory.field_t[:-1, fresh]
            memory.time_us[1:, fresh] = memory.time_us[:-1, fresh]
            memory.field_t[0, fresh] = field_t[fresh]
            same = memory.field_t[0, fresh] == memory.field_t[1, fresh]
            memory.repeats[fresh] = np.where(same, memory.repeats[fresh] + 1, 0)
            memory.time_us[0, fresh] = time_us[fresh]
        newest, previous, oldest = memory.field_t
        time, before, oldest_time = memory.time_us
        running = (time.max() - time <= self.stopped_us) & np.isfinite(field_t).any(axis=1)
        if not running.any():
            nothing = np.full_like(newest, np.nan)
            return Aligned(nothing, np.ones((len(newest), 1)), nothing, int(time.max()), memory.repeats.copy())
        instant = int(time[running].min())
        # Share of the previous sample: 0 for the chip whose newest sample is the instant, never an extrapolation.
        share = np.clip((time - instant) / np.maximum(time - before, 1), 0.0, 1.0)[:, None]
        linear = np.isfinite(previous) & (before > 0)[:, None]
        field = np.where(linear, (1.0 - share) * newest + share * previous, newest)
        field[~running] = np.nan
        # Error of linear interpolation: half the second derivative times the distances to both ends. Twice that, for
        # where a tap begins or ends, the divided difference has seen only half of the acceleration yet. A chip that is
        # faster than the frames now and then leaves a gap of two periods, over which four times as much may bend.
        behind, gap, gap_before = (
            time - instant,
            np.maximum(time - before, 1),
            np.maximum(before - oldest_time, 1),
        )
        slopes = (newest - previous) / gap[:, None] - (previous - oldest) / gap_before[:, None]
        reach = 2.0 * behind * np.maximum(gap - behind, 0) / (gap + gap_before)
        bend = np.abs(reach[:, None] * slopes)
        # A jump lies anywhere between two samples, before the instant or after it.
        jump = np.abs(slopes) * gap[:, None]
        bend = np.where((jump > JUMP_T) & (share > 0.0), np.maximum(share, 1.0 - share) * jump, bend)
        # Without a third sample the step itself bounds the error.
        step = np.abs(share * (newest - previous))
        bend = np.where(np.isfinite(bend), bend, np.where(np.isfinite(step), step, 0.0))
        return Aligned(field, root_of_squares(share, 1.0 - share), bend, instant, memory.repeats.copy())


def repeats_allowed(noise_t: Array, step_t: Array | float) -> Array:
    """(N, 3) how often in a row an axis that lives may say the same.

    noise_t: (N, 3). step_t: of a count, one number or one for each axis, which noise_t includes as rounding.
    An axis that repeats itself more often is stuck. Infinite where rounding hides the noise: a quiet axis is no fault.
    """
    before_rounding = np.sqrt(np.maximum(square(noise_t) - square(step_t) / 12.0, 0.0))
    steps = before_rounding / step_t
    return np.array([[_longest_run(deviation) for deviation in axes] for axes in steps.tolist()])


def _longest_run(deviation_steps: float) -> float:
    # Below 0.4 steps, the most frequent value takes four fifths and the estimate of the noise is itself a guess.
    if deviation_steps < 0.4:
        return float("inf")
    most_frequent = erf(0.5 / (sqrt(2.0) * deviation_steps))
    return ceil(log(FALSE_STANDSTILL) / log(most_frequent))
