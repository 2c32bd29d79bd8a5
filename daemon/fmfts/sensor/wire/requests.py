"""The requests of a host to a board: one at a time is sent, and repeated until the board answers."""

from __future__ import annotations

from collections import deque

from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.packets import ALL_PADS, Reply, Request, Verb

REPEAT_NS = 250_000_000
DEAF_AFTER = 8  # after this many repetitions of a request the board counts as deaf


class Requests:
    """A queue. A request keeps its id however often it is sent."""

    def __init__(self) -> None:
        self._queue: deque[Request] = deque()
        self._repeat_ns = 0
        self._sendings = 0
        self._next_id = 0

    @property
    def due_ns(self) -> int | None:
        """When `outgoing` next has something to send."""
        return self._repeat_ns if self._queue else None

    @property
    def unheard(self) -> bool:
        """The current request was sent more than DEAF_AFTER times without an answer."""
        return self._sendings > DEAF_AFTER

    def ask(self, verb: Verb, pad_index: int = ALL_PADS, argument: int = 0) -> None:
        """Queue a request, unless an equal one is waiting."""
        if any((verb, pad_index, argument) == (one.verb, one.pad_index, one.argument) for one in self._queue):
            return
        self._queue.append(Request(verb, self._next_id, pad_index, argument))
        self._next_id = (self._next_id + 1) % 256

    def outgoing(self, now_ns: int) -> bytes:
        """Bytes to send now, if any. The zero before the request ends a packet that was cut off."""
        if not self._queue or now_ns < self._repeat_ns:
            return b""
        self._repeat_ns = now_ns + REPEAT_NS
        self._sendings += 1
        return b"\0" + encode(self._queue[0])

    def answered(self, reply: Reply) -> Request | None:
        """The request that `reply` answers; None if that request was answered before (it was sent more than once)."""
        if not self._queue:
            return None
        first = self._queue[0]
        if (first.request_id, first.verb) != (reply.request_id, reply.request_type):
            return None
        self._repeat_ns = self._sendings = 0
        return self._queue.popleft()

    def clear(self) -> None:
        """Drop all requests, because the line is gone."""
        self._queue.clear()
        self._repeat_ns = self._sendings = 0
