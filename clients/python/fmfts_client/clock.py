"""How old a message is whose times are those of another machine's CLOCK_MONOTONIC."""

from __future__ import annotations

import math
from typing import Optional

SETTLING_S = 0.3
# Of two crystals, and what NTP slews: so fast the least difference seen is let go.
DRIFT = 500e-6


class SenderClock:
    """By how much this machine's monotonic clock is ahead of a daemon's.

    Each message arrives later than it was sent, and hardly ever by less than the least so far: that is the clocks' own
    difference, with the shortest way over the network in it. What waited in a queue differs by more, and so is seen to
    be old. Nothing is known until messages have come for a while: a backlog is taken in at once. Another `boot` may be
    after another start of that machine.
    """

    def __init__(self) -> None:
        self._boot = ""
        self._ahead_s = math.inf
        self._first_s = self._last_s = 0.0

    @property
    def ahead_s(self) -> Optional[float]:
        """None: not known yet."""
        return self._ahead_s if self._last_s - self._first_s >= SETTLING_S else None

    def heard(self, boot: str, sent_s: float, now_s: float) -> None:
        """A message that was sent at `sent_s` on the daemon's clock was taken in at `now_s` on this machine's."""
        if boot != self._boot:
            self._boot, self._ahead_s = boot, math.inf
            self._first_s = self._last_s = now_s
        self._ahead_s = min(self._ahead_s + DRIFT * (now_s - self._last_s), now_s - sent_s)
        self._last_s = now_s
