"""Estimates the difference between the clock of another machine and this one's, for the ages of messages."""

from __future__ import annotations

import math
from typing import Optional

SETTLING_S = 0.3
DRIFT = 500e-6  # relative: more than two crystals, or NTP's corrections, drift apart


class SenderClock:
    """Estimates by how much this machine's monotonic clock is ahead of a daemon's.

    The estimate is the smallest difference between receiving and sending a message; it contains the shortest delay of
    the network. A message that waited in a queue has a larger difference, and so is known to be old. The estimate is
    not valid for the first SETTLING_S, because a backlog arrives at once. It is relaxed at the rate DRIFT, and reset
    when `boot` changes, because the other machine may have restarted.
    """

    def __init__(self) -> None:
        self._boot = ""
        self._ahead_s = math.inf
        self._first_s = self._last_s = 0.0

    @property
    def ahead_s(self) -> Optional[float]:
        """The difference in s; None: not known yet."""
        return self._ahead_s if self._last_s - self._first_s >= SETTLING_S else None

    def take(self, boot: str, sent_s: float, now_s: float) -> None:
        """Take in a message that was sent at `sent_s` on the daemon's clock and received at `now_s` on this one's."""
        if boot != self._boot:
            self._boot, self._ahead_s = boot, math.inf
            self._first_s = self._last_s = now_s
        self._ahead_s = min(self._ahead_s + DRIFT * (now_s - self._last_s), now_s - sent_s)
        self._last_s = now_s
