"""Aligns the samples of a pad with several magnets, or with unknown ones: push.c, which alignment.c calls for one."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import log, square
from fmfts.arithmetic.series import erf
from fmfts.pose import _alignment

Array = NDArray[np.float64]
Times = NDArray[np.int64]

# Probability that a healthy axis repeats one value so often: once in ten hours on a pad of twelve axes at 220 Hz.
FALSE_STANDSTILL = 1e-8


class Aligned(NamedTuple):
    """field_t (N, 3): at `time_us` (the board's clock), NaN where a sensor has no value.

    noise_share (N, 1): noise of field_t over that of one sample. bend_t (N, 3): the error that curvature may cause.
    repeats (N, 3): how many new samples in a row repeated the value before. is_old: no new sample came for too long.
    began_anew: the board's clock restarted. leap_us: by how much that clock jumped before this frame, beyond the time
    that passed. foreign_t2 (3N, 3N): covariance of the posture's field that remains in field_t; None if no hand carries
    the pad.
    """

    field_t: Array
    noise_share: Array
    bend_t: Array
    time_us: int
    repeats: NDArray[np.int64]
    is_old: bool = False
    began_anew: bool = False
    leap_us: int = 0
    foreign_t2: Array | None = None

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
        self._period_us = period_us
        self._newest_us = self._leap_us = 0  # time of the newest sample, on its clock; leap of the board's clock since

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

        timed (N,): which sensors gave a sample with its time; None: all. The `time_us` of the others is meaningless,
        because their age is not known. Without any such sensor the instant stays; after a jump of the board's clock it
        is converted to the new time. frame_us: the frame's own time; None: that of its newest sample. leap_us: see
        Aligned.
        """
        self._newest_us = int(self.memory.time_us[0].max()) or self._newest_us
        aligned = self._push(field_t, time_us, fresh, timed, frame_us)
        if not self.memory.without_news:
            self._leap_us = 0
            return aligned._replace(leap_us=leap_us) if leap_us else aligned
        self._leap_us += leap_us
        on_old_clock_us = aligned.time_us or self._newest_us  # 0: all samples were forgotten
        return aligned._replace(leap_us=leap_us, time_us=on_old_clock_us + self._leap_us)

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
            self._period_us,
            memory.without_news,
            frame_us is not None,
            frame_us or 0,
        )
        return Aligned(field, share, bend, instant_us, repeats, is_old, began_anew)


def repeats_allowed(noise_t: Array, step_t: Array | float) -> Array:
    """How often in a row (N, 3) a healthy axis may repeat one value; an axis that repeats it more often is stuck.

    noise_t (N, 3): includes rounding. step_t: tesla per count, one number or one for each axis. The result is infinite
    where rounding hides the noise: a healthy axis may then repeat one value for ever.
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
