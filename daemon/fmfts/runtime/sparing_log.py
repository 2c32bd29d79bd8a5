"""The log of one pad, with a limit for an overloaded computer, on which health changes many times a second."""

from __future__ import annotations

import logging
from collections import deque

from fmfts.runtime.lateness import Lateness

log = logging.getLogger(__name__)

PERIOD_NS = 10_000_000_000
MOST = 3  # a short stall causes this many changes, each worth a line


class SparingLog:
    """Logs lines of one kind about a pad: reports of an overload must not keep changes of health out of the log.

    While frames are dropped, at most MOST changes in PERIOD_NS; the next one has the number of the omitted ones, and
    quotes the last one of each other state. A line's state is its text before ":". A change is logged at its own level:
    if an omitted one is worse, the omitted ones have a line before it.
    """

    def __init__(self, pad: str, lateness: Lateness) -> None:
        self._pad = pad
        self._lateness = lateness
        self._told_ns: deque[int] = deque(maxlen=MOST)
        self._held: dict[str, tuple[int, str]] = {}  # the last omitted line of each state, the newest at the end
        self._untold = 0

    def tell(self, level: int, text: str, now_ns: int, *, is_urgent: bool = False) -> None:
        """is_urgent: no overload causes it, so it is logged at once."""
        state = text.partition(":")[0]
        self._held.pop(state, None)
        self._held[state] = level, text
        self._untold += 1
        if is_urgent or not self._lateness.is_behind(now_ns, PERIOD_NS) or not self._has_told_enough(now_ns):
            self._write(now_ns)

    def catch_up(self, now_ns: int) -> None:
        """Log the last omitted line when it is due. Call it about once a second."""
        if self._held and not self._has_told_enough(now_ns):
            self._write(now_ns)

    def _has_told_enough(self, now_ns: int) -> bool:
        return len(self._told_ns) == MOST and now_ns - self._told_ns[0] < PERIOD_NS

    def _write(self, now_ns: int) -> None:
        *others, (level, text) = self._held.values()
        worst = max((other for other, _ in others), default=level)
        unlogged = _unlogged(self._untold - 1, [other for _, other in others])
        if worst > level:
            log.log(worst, "pad '%s': %s", self._pad, unlogged)
            unlogged = ""
        log.log(level, "pad '%s': %s%s", self._pad, text, f" ({unlogged})" if unlogged else "")
        self._told_ns.append(now_ns)
        self._held.clear()
        self._untold = 0


def _unlogged(changes: int, others: list[str]) -> str:
    if changes == 0:
        return ""
    which = "1 change is" if changes == 1 else f"{changes} changes are"
    quoted = f": among them {'; '.join(others)}" if others else ""
    return f"{which} not in the log, because the computer was overloaded{quoted}"
