"""Impossible frames of a pad: dropped, counted and reported."""

from __future__ import annotations

import logging

from fmfts.runtime.announcer import Announcer
from fmfts.runtime.sparing_log import SparingLog
from fmfts.runtime.statistics import PadStatistics

NAMED_NS = 10_000_000_000  # how long the status reports an impossible frame; the log reports one in that time


class ImpossibleFrames:
    """last: the fault of the last one; "" if there was none. last_ns: when it came, or 0."""

    def __init__(self, statistics: PadStatistics, log: SparingLog, announcer: Announcer) -> None:
        self.last, self.last_ns = "", 0
        self._statistics = statistics
        self._log = log
        self._announcer = announcer
        self._logged_ns = 0

    def leave_out(self, flaw: str, now_ns: int) -> None:
        self._statistics.reject()
        self.last, self.last_ns = flaw, now_ns
        if now_ns - self._logged_ns >= NAMED_NS:
            self._logged_ns = now_ns
            text = f"a frame is rejected: {flaw}"
            self._log.tell(logging.WARNING, text, now_ns)
            self._announcer.event("rejected", text)

    def recent(self, now_ns: int) -> list[str]:
        """The last one, for as long as the status names it."""
        return [self.last] if self.last and now_ns - self.last_ns < NAMED_NS else []
