"""Decides which of a pad's frames are too old to be published, and reports an overloaded computer in the status."""

from __future__ import annotations

import time

from fmfts.runtime.statistics import PadStatistics
from fmfts.sensor import Source

# Older frames are not published: a controller would act on an outdated contact. Newer ones follow.
OVERDUE_NS = 50_000_000
OVERLOADED = 0.01  # share of dropped frames above which the status reports it


class Lateness:
    """overdue_ns: the age above which a frame is dropped. sentence: empty unless this computer is overloaded."""

    def __init__(self, source: Source, pad_index: int, rate_hz: float, statistics: PadStatistics) -> None:
        # At low rates a frame's newest sample may be nearly a period old when it is sent.
        self.overdue_ns = max(OVERDUE_NS, int(1e9 / rate_hz))
        self.sentence = ""
        self._source = source
        self._pad_index = pad_index
        self._statistics = statistics
        self._counted = 0  # of `state.left_out`
        self._late_s = 0.0
        self._behind_ns: int | None = None  # when a frame was last dropped

    def is_to_be_left_out(self, taken_ns: int, now_ns: int, superseded: bool = False) -> bool:
        """Whether a frame of that time is too old, or superseded by another. If it is, it is counted."""
        self._late_s = (now_ns - taken_ns) * 1e-9
        left_out = superseded or now_ns - taken_ns > self.overdue_ns
        if left_out:
            self._statistics.refuse()
            self._behind_ns = now_ns
        return left_out

    def is_late(self, taken_ns: int, now_ns: int) -> bool:
        """Whether a sample of that time is too old; it is not counted: its frame is."""
        return now_ns - taken_ns > self.overdue_ns

    def count_left_out(self) -> bool:
        """Count the frames that were left out before anybody saw them. True if there are new ones."""
        left_out = self._source.state.left_out.get(self._pad_index, 0)
        new, self._counted = left_out - self._counted, left_out
        if new:
            self._statistics.leave_out(new)
            self._behind_ns = time.monotonic_ns()
        return new > 0

    def is_behind(self, now_ns: int, within_ns: int) -> bool:
        """Whether frames were left out that recently."""
        return self._behind_ns is not None and now_ns - self._behind_ns < within_ns

    def judge(self, health: str) -> str:
        """Judge the interval that the statistics just ended.

        Returns a text if an overload began or ended, else "". health: of the pad, which an overload does not change.
        """
        before, percent = self.sentence, 100 * self._statistics.overloaded
        is_overloaded = self._statistics.overloaded >= OVERLOADED
        self.sentence = f"this computer is overloaded: {percent:.0f} % of the frames left out" if is_overloaded else ""
        if bool(before) == is_overloaded:
            return ""
        if is_overloaded:
            return f"{self.sentence}; health is {'still ' * (health == 'ok')}{health}; see docs/latency.md"
        return f"this computer keeps up again: no frames are left out; health is {health}"

    @property
    def reason(self) -> str:
        """Why frames arrive, but none is used."""
        late = f"{self._late_s:.2f} s late" if self._late_s * 1e9 > self.overdue_ns else "too late"
        clock = ", or the clock of the board stands" if self._source.state.has_clock else ""
        return f"frames come {late}: {self.sentence or f'this computer is overloaded{clock}'}"
