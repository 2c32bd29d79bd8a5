"""Alignment as defined by docs/tracking.md and the field's own shape, from the whole history of each sensor.

The instant is that of the sensor whose newest sample is oldest; each sensor is interpolated linearly between the two
samples around it (the newest two). The noise of a weighted mean w a + (1 − w) b of independent samples is
sqrt(w² + (1 − w)²). The bend is twice what a parabola through the last three samples differs from the chord at the
instant (twice: where a tap begins, half of its acceleration is in the divided difference); where the slope jumps by
more than half a gauss between two samples, the jump may be anywhere between them. Without a third sample it is the
step itself.

push.h and push.c define which samples are new, and the effect of a gap, a restarted clock and a stopped chip.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from oracle.field import Array

JUMP_T = 5e-5
STOPPED_PERIODS, LOST_PERIODS, NEW_PERIODS, OLD_PERIODS = 2.5, 1.5, 0.5, 4.0
MOST_WITHOUT_NEWS = 3
LONGEST_GAP_US = 3e5

Flags = NDArray[np.bool_]
Times = NDArray[np.int64]


@dataclass(slots=True)
class History:
    """All samples of one sensor since the last gap: times in µs, fields (3,). run: how often each axis has repeated."""

    times: list[int] = field(default_factory=list)
    fields: list[Array] = field(default_factory=list)
    run: Times = field(default_factory=lambda: np.zeros(3, dtype=np.int64))

    def add(self, time_us: int, field_t: Array) -> None:
        same = field_t == self.fields[-1] if self.fields else np.zeros(3, dtype=bool)
        self.run = np.where(same, self.run + 1, 0)
        self.times.append(time_us)
        self.fields.append(field_t)

    def forget(self) -> None:
        self.times, self.fields = [], []

    @property
    def newest_us(self) -> int:
        return self.times[-1] if self.times else 0

    def at(self, instant_us: int) -> tuple[Array, float, Array]:
        """Field (3,), share of a sample's noise, and bend (3,)."""
        if not self.times:
            return np.full(3, np.nan), 1.0, np.zeros(3)
        axes = [self._axis(instant_us, axis) for axis in range(3)]
        return np.array([value for value, _ in axes]), self._share(instant_us), np.array([bend for _, bend in axes])

    def _last(self, count: int) -> list[int]:
        """The last times, newest first; a sample is at least a microsecond later than the one before."""
        times = [self.times[-1]]
        for one, before in list(zip(self.times[::-1], self.times[-2::-1], strict=False))[: count - 1]:
            times.append(times[-1] - max(one - before, 1))
        return times

    def _place(self, instant_us: int) -> float:
        """0 at the sample before the last, 1 at the last."""
        t0, t1 = self._last(2)
        return float(np.clip((instant_us - t1) / (t0 - t1), 0.0, 1.0))

    def _share(self, instant_us: int) -> float:
        if len(self.times) == 1:
            return 1.0
        place = self._place(instant_us)
        return float(np.hypot(place, 1.0 - place))

    def _axis(self, instant_us: int, axis: int) -> tuple[float, float]:
        """Value and bend. A sample without a value on this axis ends its history."""
        values = [float(each[axis]) for each in self.fields[:-4:-1]]
        f0, f1, f2 = values + [np.nan] * (3 - len(values))
        if np.isnan(f0) or np.isnan(f1):
            return f0, 0.0
        place = self._place(instant_us)
        value = f1 + place * (f0 - f1)
        if np.isnan(f2):
            return value, abs((1.0 - place) * (f0 - f1))
        t0, t1, t2 = self._last(3)
        kink = abs((f0 - f1) / (t0 - t1) - (f1 - f2) / (t1 - t2)) * (t0 - t1)
        if kink > JUMP_T and place < 1.0:
            return value, max(place, 1.0 - place) * kink
        if not 0.0 < place < 1.0:
            return value, 0.0
        at = float(instant_us)  # Lagrange's parabola
        parabola = (
            f0 * ((at - t1) * (at - t2) / ((t0 - t1) * (t0 - t2)))
            + f1 * ((at - t0) * (at - t2) / ((t1 - t0) * (t1 - t2)))
            + f2 * ((at - t0) * (at - t1) / ((t2 - t0) * (t2 - t1)))
        )
        return value, 2.0 * abs(parabola - value)


@dataclass(frozen=True, slots=True)
class Seen:
    """fields, bends (N, 3), shares (N,); NaN where a sensor does not run."""

    instant_us: int
    fields: Array
    shares: Array
    bends: Array
    is_old: bool
    began_anew: bool
    running: Flags
    lone: Flags  # whether a sensor has one sample alone


class Chips:
    """The histories of a pad's N sensors."""

    def __init__(self, count: int, period_us: float) -> None:
        self.histories = [History() for _ in range(count)]
        self.period_us, self.without_news = period_us, 0

    @property
    def newest_us(self) -> int:
        return max(each.newest_us for each in self.histories)

    def push(self, field_t: Array, time_us: Times, fresh: Flags, timed: Flags | None, frame_us: int | None) -> Seen:
        timed = np.ones(len(fresh), dtype=bool) if timed is None else timed
        began_anew = self._forget_before_gap(time_us[timed])
        new = self._new(time_us, fresh, timed)
        for sensor in np.flatnonzero(new).tolist():
            self.histories[sensor].add(int(time_us[sensor]), field_t[sensor])
        self.without_news = 0 if new.any() else self.without_news + 1
        late = self.without_news > 0 and frame_us is not None
        is_old = self.without_news > MOST_WITHOUT_NEWS
        is_old |= late and (frame_us or 0) - self.newest_us > OLD_PERIODS * self.period_us
        return self._at_one_instant(field_t, is_old, began_anew)

    def _forget_before_gap(self, told_us: Times) -> bool:
        """Whether the board's clock began again."""
        if not told_us.size or not any(each.times for each in self.histories):
            return False
        later_us, stopped_us = int(told_us.max()) - self.newest_us, STOPPED_PERIODS * self.period_us
        if later_us < -stopped_us or later_us > max(LONGEST_GAP_US, stopped_us):
            for history in self.histories:
                history.forget()
        return later_us < -stopped_us

    def _new(self, time_us: Times, fresh: Flags, timed: Flags) -> Flags:
        """If a frame was lost, a sample that first occurred in it is new, too."""
        lost = fresh.any() and time_us[fresh].max() - self.newest_us > LOST_PERIODS * self.period_us
        later_us = time_us - [each.newest_us for each in self.histories]
        return np.asarray(fresh | (timed & lost & (later_us > NEW_PERIODS * self.period_us)))

    def _at_one_instant(self, field_t: Array, is_old: bool, began_anew: bool) -> Seen:
        newest_us = np.array([each.newest_us for each in self.histories])
        running = newest_us.max() - newest_us <= STOPPED_PERIODS * self.period_us
        running &= np.isfinite(field_t).any(axis=1) & (not is_old)
        instant_us = int(newest_us[running].min() if running.any() else newest_us.max())
        seen = [each.at(instant_us) for each in self.histories]
        fields, shares, bends = (np.array(each) for each in zip(*seen, strict=True))
        fields[~running] = bends[~running] = np.nan
        lone = np.array([len(each.times) == 1 for each in self.histories])
        return Seen(instant_us, fields, shares, bends, is_old, began_anew, running, lone)
