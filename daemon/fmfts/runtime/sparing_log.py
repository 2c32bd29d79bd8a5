"""The log of one pad, with a limit for an overloaded computer, on which health changes many times a second."""

from __future__ import annotations

import logging
from collections import deque

from fmfts.runtime.lateness import Lateness

log = logging.getLogger(__name__)

PERIOD_NS = 10_000_000_000
MOST = 3  # a short stall causes this many changes, each worth a line


class SparingLog:
    """Logs lines of a pad. While frames are dropped, at most MOST in PERIOD_NS; the next line has the number of the
    omitted ones."""

    def __init__(self, pad: str, lateness: Lateness) -> None:
        self._pad = pad
        self._lateness = lateness
        self._told_ns: deque[int] = deque(maxlen=MOST)
        self._held: tuple[int, str] | None = None  # the last omitted line
        self._untold = 0

    def tell(self, level: int, text: str, now_ns: int, *, is_urgent: bool = False) -> None:
        """is_urgent: no overload causes it, so it is logged at once."""
        is_behind = self._lateness.is_behind(now_ns, PERIOD_NS)
        if is_behind and not is_urgent and self._has_told_enough(now_ns):
            self._held, self._untold = (level, text), self._untold + 1
        else:
            self._write(level, text, self._untold, now_ns)

    def catch_up(self, now_ns: int) -> None:
        """Log the last omitted line when it is due. Call it about once a second."""
        if self._held is not None and not self._has_told_enough(now_ns):
            self._write(*self._held, self._untold - 1, now_ns)

    def _has_told_enough(self, now_ns: int) -> bool:
        return len(self._told_ns) == MOST and now_ns - self._told_ns[0] < PERIOD_NS

    def _write(self, level: int, text: str, untold: int, now_ns: int) -> None:
        log.log(level, "pad '%s': %s%s", self._pad, text, _unlogged(untold))
        self._told_ns.append(now_ns)
        self._held, self._untold = None, 0


def _unlogged(changes: int) -> str:
    if changes == 0:
        return ""
    which = "1 change before this one is" if changes == 1 else f"{changes} changes before this one are"
    return f" ({which} not in the log, because the computer was overloaded)"
