"""Interpolates the samples of chips that run on their own clocks to one instant.

The samples of a frame are up to one period (4.5 ms) apart; in that time a tap changes the field by more than its noise.
The instant is the newest that every chip has passed, so it lies between two samples of each chip. Interpolation adds no
noise; it neglects only the curvature of the motion, which is added to the deviation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import log, square
from fmfts.arithmetic.series import erf
from fmfts.pose import _alignment

Array = NDArray[np.float64]
Times = NDArray[np.int64]

# A chip that is this many periods behind the others has stopped: the others do not wait for it.
STOPPED_PERIODS = 2.5
# Shares of STOPPED_PERIODS. After 1.5 periods without a frame, one was lost, or left out as newer ones superseded it.
# Then a sample is new, too, that is half a period later than the last one: the frame that had it first never came here.
GAP_SHARE, UNSEEN_SHARE = 0.6, 0.2
# After so many frames without any new sample, or periods of them, none of a chip is in them: the next one tells of the
# past. Frames are left out by a computer that has too little time, so that they alone do not count it.
MOST_WITHOUT_NEWS = 3
# After a longer gap than this (or STOPPED_PERIODS, at low rates) the samples before it say nothing of the motion since:
# the line from them to the next sample would make that as uncertain as the whole way that the pad moved in the gap.
LONGEST_GAP_US = 300_000.0
# Probability that a healthy axis repeats one value so often: once in ten hours on a pad of twelve axes at 220 Hz.
FALSE_STANDSTILL = 1e-8
# A sample jumps if it is half a gauss off the line through the two before; a tap of 1 N in 50 ms is off by a tenth.
JUMP_T = 5e-5


@dataclass(frozen=True, slots=True)
class Aligned:
    """field_t (N, 3): at `time_us` (the board's clock), NaN where a sensor has no value.

    noise_share (N, 1): noise of field_t over that of one sample. bend_t (N, 3): the error that curvature may cause.
    repeats (N, 3): how many new samples in a row repeated the value before. is_old: nothing new came for too long.
    began_anew: the board's clock did. leap_us: by how much it leapt before this frame, beyond the time that passed.
    """

    field_t: Array
    noise_share: Array
    bend_t: Array
    time_us: int
    repeats: NDArray[np.int64]
    is_old: bool = False
    began_anew: bool = False
    leap_us: int = 0

    def elapsed_s(self, last_us: int | None) -> float:
        """How long ago the last frame's instant was; 0 without one."""
        return 0.0 if last_us is None else max(self.time_us - last_us - self.leap_us, 0) * 1e-6


@dataclass(slots=True)
class AlignmentMemory:
    """field_t (3, N, 3) and time_us (3, N): the three newest samples of each sensor, newest first; repeats (N, 3).

    without_news: how many frames in a row brought no new sample of any sensor.
    """

    field_t: Array
    time_us: Times
    repeats: NDArray[np.int64]
    without_news: int = 0


class Alignment:
    """Aligns the samples of `count` sensors; keeps the last three of each."""

    def __init__(self, count: int, period_us: float) -> None:
        self.memory = AlignmentMemory(
            np.full((3, count, 3), np.nan), np.zeros((3, count), dtype=np.int64), np.zeros((count, 3), dtype=np.int64)
        )
        self.stopped_us = STOPPED_PERIODS * period_us
        self._old_us = (MOST_WITHOUT_NEWS + 1) * period_us
        self._newest_us = self._leap_us = 0  # of the newest sample, on its clock; how far the board's has leapt since
        # As push.c takes them.
        limits_us = self.stopped_us, longest_gap_us(self.stopped_us), self._old_us
        self._periods = *limits_us, GAP_SHARE, UNSEEN_SHARE, JUMP_T, MOST_WITHOUT_NEWS

    def push(
        self,
        field_t: Array,
        time_us: Times,
        fresh: NDArray[np.bool_],
        timed: NDArray[np.bool_] | None = None,
        frame_us: int | None = None,
        leap_us: int = 0,
    ) -> Aligned:
        """Add a frame, and align. field_t (N, 3), time_us (N,): the newest samples. fresh (N,): which are new.

        timed (N,): which sensors gave a sample at all, and tell its time; None: all. The `time_us` of the others means
        nothing, because their age is not known. Without any such sensor, the instant stays where it was: after a leap,
        where the board's clock now says that it was. frame_us: the frame's own time; None: that of its newest sample.
        leap_us: see Aligned.
        """
        self._newest_us = int(self.memory.time_us[0].max()) or self._newest_us
        aligned = self._push(field_t, time_us, fresh, timed, frame_us)
        if not self.memory.without_news:
            self._leap_us = 0
            return replace(aligned, leap_us=leap_us) if leap_us else aligned
        self._leap_us += leap_us
        on_old_clock_us = aligned.time_us or self._newest_us  # 0: all samples were forgotten
        return replace(aligned, leap_us=leap_us, time_us=on_old_clock_us + self._leap_us)

    def _push(
        self,
        field_t: Array,
        time_us: Times,
        fresh: NDArray[np.bool_],
        timed: NDArray[np.bool_] | None,
        frame_us: int | None,
    ) -> Aligned:
        memory, shape = self.memory, field_t.shape
        field, bend, share = np.empty(shape), np.empty(shape), np.empty((shape[0], 1))
        repeats = np.empty(shape, dtype=np.int64)
        instant_us, is_old, began_anew, memory.without_news = _alignment.push(
            memory.field_t,
            memory.time_us,
            memory.repeats,
            np.ascontiguousarray(field_t, np.float64),
            np.ascontiguousarray(time_us, np.int64),
            np.ascontiguousarray(fresh, np.bool_),
            None if timed is None else np.ascontiguousarray(timed, np.bool_),
            field,
            share,
            bend,
            repeats,
            *self._periods,
            memory.without_news,
            frame_us is not None,
            frame_us or 0,
        )
        return Aligned(field, share, bend, instant_us, repeats, is_old, began_anew)


def has_jumped(aligned: Aligned) -> bool:
    """Whether an axis has a sample of which it is not known when its field changed. alignment.c does the same."""
    return bool((aligned.bend_t > JUMP_T / 2.0).any())


def longest_gap_us(stopped_us: float) -> float:
    """The longest time between two frames over which samples are interpolated. stopped_us: see Alignment."""
    return max(LONGEST_GAP_US, stopped_us)


def repeats_allowed(noise_t: Array, step_t: Array | float) -> Array:
    """How often in a row (N, 3) a healthy axis may repeat one value; an axis that repeats it more often is stuck.

    noise_t (N, 3): includes rounding. step_t: tesla per count, one number or one for each axis. The result is infinite
    where rounding hides the noise: such an axis may stay the same without a fault.
    """
    before_rounding = np.sqrt(np.maximum(square(noise_t) - square(step_t) / 12.0, 0.0))
    steps = before_rounding / step_t
    return np.array([[_longest_run(deviation) for deviation in axes] for axes in steps.tolist()])


def _longest_run(deviation_steps: float) -> float:
    # Below 0.4 steps, four fifths of the samples have one value, and the noise itself is poorly known.
    if deviation_steps < 0.4:
        return float("inf")
    most_frequent = erf(0.5 / (sqrt(2.0) * deviation_steps))
    return ceil(log(FALSE_STANDSTILL) / log(most_frequent))
