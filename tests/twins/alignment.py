"""Alignment in NumPy, as docs/tracking.md and the docstrings of pose/alignment.py say it.

Not a witness: it was the daemon's own, and holds push.c to the last bit. tests/oracle/sampling.py judges both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import root_of_squares
from fmfts.pose.alignment import (
    GAP_SHARE,
    JUMP_T,
    MOST_WITHOUT_NEWS,
    UNSEEN_SHARE,
    Aligned,
    Alignment,
    longest_gap_us,
)

Array = NDArray[np.float64]
Times = NDArray[np.int64]


class NumPyAlignment(Alignment):
    def _push(
        self,
        field_t: Array,
        time_us: Times,
        fresh: NDArray[np.bool_],
        timed: NDArray[np.bool_] | None,
        frame_us: int | None,
    ) -> Aligned:
        memory = self.memory
        told_us = time_us if timed is None else time_us[timed]
        began_anew = False
        if told_us.size and memory.time_us[0].any():
            later_us = told_us.max() - memory.time_us[0].max()
            # The board was reset, so its clock began again; or no frame came for long.
            began_anew = bool(later_us < -self.stopped_us)
            if began_anew or later_us > longest_gap_us(self.stopped_us):
                memory.field_t[:], memory.time_us[:] = np.nan, 0
        fresh = self._new(time_us, fresh, timed)
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
        memory.without_news = 0 if fresh.any() else memory.without_news + 1
        newest, previous, oldest = memory.field_t
        time, before, oldest_time = memory.time_us
        running = (time.max() - time <= self.stopped_us) & np.isfinite(field_t).any(axis=1)
        is_old = memory.without_news > MOST_WITHOUT_NEWS
        if memory.without_news and frame_us is not None:
            is_old |= bool(frame_us - time.max() > self._old_us)
        if not running.any() or is_old:
            nothing, share_of_one = np.full_like(newest, np.nan), np.ones((len(newest), 1))
            repeats = memory.repeats.copy()
            return Aligned(nothing, share_of_one, nothing, int(time.max()), repeats, is_old, began_anew)
        instant = int(time[running].min())
        # Share of the previous sample: 0 for the chip whose newest sample is at the instant. It never extrapolates.
        share = np.clip((time - instant) / np.maximum(time - before, 1), 0.0, 1.0)[:, None]
        linear = np.isfinite(previous) & (before > 0)[:, None]
        field = np.where(linear, (1.0 - share) * newest + share * previous, newest)
        field[~running] = np.nan
        # Error of linear interpolation: half the second derivative times the distances to both ends. Taken twice: where
        # a tap begins or ends, the divided difference contains only half of the acceleration. A chip that is faster
        # than the frames sometimes leaves a gap of two periods, in which the error may be four times as large.
        behind, gap, gap_before = (
            time - instant,
            np.maximum(time - before, 1),
            np.maximum(before - oldest_time, 1),
        )
        slopes = (newest - previous) / gap[:, None] - (previous - oldest) / gap_before[:, None]
        reach = 2.0 * behind * np.maximum(gap - behind, 0) / (gap + gap_before)
        bend = np.abs(reach[:, None] * slopes)
        # A jump may be anywhere between two samples, before or after the instant.
        jump = np.abs(slopes) * gap[:, None]
        bend = np.where((jump > JUMP_T) & (share > 0.0), np.maximum(share, 1.0 - share) * jump, bend)
        # Without a third sample the step itself bounds the error.
        step = np.abs(share * (newest - previous))
        bend = np.where(np.isfinite(bend), bend, np.where(np.isfinite(step), step, 0.0))
        bend[~running] = 0.0  # what is not told has no error
        noise_share, repeats = root_of_squares(share, 1.0 - share), memory.repeats.copy()
        return Aligned(field, noise_share, bend, instant, repeats, began_anew=began_anew)

    def _new(self, time_us: Times, fresh: NDArray[np.bool_], timed: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
        """Which samples (N,) are not in the memory: fresh ones, and those that were fresh in a frame unseen here."""
        before_us = self.memory.time_us[0]
        has_gap = fresh.any() and time_us[fresh].max() - before_us.max() > GAP_SHARE * self.stopped_us
        if not has_gap:
            return fresh
        unseen = time_us - before_us > UNSEEN_SHARE * self.stopped_us
        new: NDArray[np.bool_] = fresh | (unseen if timed is None else unseen & timed)
        return new
