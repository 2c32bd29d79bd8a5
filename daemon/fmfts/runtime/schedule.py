"""Which sources are to be polled now: those that have bytes, and those whose time has come."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence

from fmfts.runtime.fast_loop import Express
from fmfts.sensor import Source

log = logging.getLogger(__name__)

NEVER_NS = 1 << 62


class Schedule:
    """All that the daemon waits for, in `express`. What a wake-up costs does not grow with the sources that sleep on.

    A source's deadline is asked for when it was served and had no frame, and in each `review`: a frame moves deadlines
    away. Between reviews the earliest one known may be in the past, never too late.

    called: since the last `wait`, something that `wake_for` named has something to read.
    """

    def __init__(self, sources: Sequence[Source], express: Express) -> None:
        self._sources = sources
        self._express = express
        self._source_of: dict[int, Source] = {}
        self._descriptor_of: dict[int, int] = {}  # id of a source → what is registered for it
        self._deadline_ns = 0
        self.called = False

    def wake_for(self, descriptor: int) -> None:
        """`wait` returns, too, when this has something to read."""
        self._express.register(descriptor)

    def wait(self, until_ns: int) -> list[Source]:
        """Sleep until something is readable or due, at most until `until_ns`; the sources that are."""
        readable = self._express.wait(min(until_ns, self._deadline_ns))
        ready = [source for descriptor in readable if (source := self._source_of.get(descriptor)) is not None]
        self.called = len(ready) < len(readable)
        now_ns = time.monotonic_ns()
        if now_ns < self._deadline_ns:
            return ready
        for source in self._sources:
            deadline_ns = source.deadline_ns()
            if deadline_ns is not None and deadline_ns <= now_ns and source not in ready:
                ready.append(source)
        self.review()
        return ready

    def review(self) -> None:
        """Deadlines may have come nearer: something was asked of a source."""
        self._deadline_ns = min(
            (d for source in self._sources if (d := source.deadline_ns()) is not None), default=NEVER_NS
        )

    def served(self, source: Source, had_frames: bool = False) -> None:
        """Wait on what the source has open now: an unplugged and reopened device has another descriptor."""
        if not had_frames and (deadline_ns := source.deadline_ns()) is not None:
            self._deadline_ns = min(self._deadline_ns, deadline_ns)
        before, descriptor = self._descriptor_of.get(id(source)), source.fileno()
        if before == descriptor:
            return
        if before is not None:
            self._forget(source, before)
        if descriptor is not None:
            self._express.register(descriptor)
            self._source_of[descriptor], self._descriptor_of[id(source)] = source, descriptor

    def _forget(self, source: Source, descriptor: int) -> None:
        del self._descriptor_of[id(source)]
        if self._source_of.get(descriptor) is not source:
            return  # closed, and another source's by now
        del self._source_of[descriptor]
        try:
            self._express.unregister(descriptor)
        except OSError:  # a closed descriptor has left epoll by itself
            log.debug("descriptor %d was closed already", descriptor)
