"""Decides which sources to poll now: those with bytes to read, and those whose deadline has come."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence

from fmfts.runtime.fast_loop import FastLoop
from fmfts.sensor import Source

log = logging.getLogger(__name__)

NEVER_NS = 1 << 62


class Schedule:
    """Waits in `fast_loop` for everything that the daemon must react to. Sources with nothing to do cost nothing.

    It asks a source for its deadline after a poll without a frame, when the known deadline has come, and in each
    `review`; a frame only moves deadlines later. So a known deadline may be too early, but never too late.

    called: in the last `wait`, a descriptor of `wake_for` had something to read.
    """

    def __init__(self, sources: Sequence[Source], fast_loop: FastLoop) -> None:
        self._sources = sources
        self._fast_loop = fast_loop
        self._source_of: dict[int, Source] = {}
        self._descriptor_of: dict[int, int] = {}  # id of a source → what is registered for it
        self._due_ns = {id(source): 0 for source in sources}  # the deadline that each source told last
        self._turn = 0
        self._served_in: dict[int, int] = {}  # id of a source → the turn in which it was last returned
        self.called = False

    def wake_for(self, descriptor: int) -> None:
        """`wait` also returns when this descriptor has something to read."""
        self._fast_loop.register(descriptor)

    def sleep_through(self, descriptor: int) -> None:
        """`wait` no longer returns because of this descriptor."""
        self._fast_loop.unregister(descriptor)

    def wait(self, until_ns: int) -> Source | None:
        """Sleep until something is readable or due, at most until `until_ns`. Returns the source to poll.

        Only one, that which has waited for the most turns: a frame that Python judges takes as long as twenty in C, and
        C goes on between two turns. The others are still readable or due in the next turn.
        """
        readable = self._readable(until_ns)
        now_ns = time.monotonic_ns()
        due = [source for source in self._sources if self._due_ns[id(source)] <= now_ns and source not in readable]
        for source in sorted(readable + due, key=lambda source: self._served_in.get(id(source), 0)):
            if source in readable or self._asked_ns(source) <= now_ns:
                self._turn += 1
                self._served_in[id(source)] = self._turn
                self._fast_loop.left_waiting(other.fileno() for other in readable if other is not source)
                return source
        return None

    def _readable(self, until_ns: int) -> list[Source]:
        """Sleep. Returns the sources with something to read."""
        readable = self._fast_loop.wait(min([until_ns, *self._due_ns.values()]))
        sources = [source for descriptor in readable if (source := self._source_of.get(descriptor)) is not None]
        self.called = len(sources) < len(readable)
        return sources

    def _asked_ns(self, source: Source) -> int:
        """Ask the source for its deadline."""
        deadline_ns = source.deadline_ns()
        self._due_ns[id(source)] = due_ns = NEVER_NS if deadline_ns is None else deadline_ns
        return due_ns

    def review(self) -> None:
        """Ask all sources for their deadlines again: a request to a source may have moved its deadline."""
        for source in self._sources:
            self._asked_ns(source)

    def served(self, source: Source, had_frames: bool = False) -> None:
        """Call it after polling a source. Its descriptor may have changed: a reopened device has another one."""
        if not had_frames:
            self._asked_ns(source)
        before, descriptor = self._descriptor_of.get(id(source)), source.fileno()
        if before == descriptor:
            return
        if before is not None:
            self._forget(source, before)
        if descriptor is not None:
            self._fast_loop.register(descriptor)
            self._source_of[descriptor], self._descriptor_of[id(source)] = source, descriptor

    def _forget(self, source: Source, descriptor: int) -> None:
        del self._descriptor_of[id(source)]
        if self._source_of.get(descriptor) is not source:
            return  # the descriptor was closed, and now belongs to another source
        del self._source_of[descriptor]
        try:
            self._fast_loop.unregister(descriptor)
        except OSError:  # epoll drops closed descriptors by itself
            log.debug("descriptor %d was closed already", descriptor)
