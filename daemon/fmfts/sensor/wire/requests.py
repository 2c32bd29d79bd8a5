"""What a host asks of a board: one request on its way at a time, sent again until it is answered."""

from __future__ import annotations

from collections import deque

from fmfts.sensor.wire.framing import encode
from fmfts.sensor.wire.packets import ALL_PADS, Reply, Request, Verb

REPEAT_NS = 250_000_000
DEAF_AFTER = 8  # sendings of one request


class Requests:
    """In the order asked; a request keeps its id however often it is sent."""

    def __init__(self) -> None:
        self._queue: deque[Request] = deque()
        self._repeat_ns = 0
        self._sendings = 0
        self._next_id = 0

    @property
    def due_ns(self) -> int | None:
        """When `outgoing` has something to say."""
        return self._repeat_ns if self._queue else None

    @property
    def unheard(self) -> bool:
        """The request on its way was sent often enough for the board to have heard it."""
        return self._sendings > DEAF_AFTER

    def ask(self, verb: Verb, pad_index: int = ALL_PADS, argument: int = 0) -> None:
        """Once: what is waiting already is not asked for again."""
        if any((verb, pad_index, argument) == (one.verb, one.pad_index, one.argument) for one in self._queue):
            return
        self._queue.append(Request(verb, self._next_id, pad_index, argument))
        self._next_id = (self._next_id + 1) % 256

    def outgoing(self, now_ns: int) -> bytes:
        """Bytes to send now, if any; the zero before the request ends what was torn."""
        if not self._queue or now_ns < self._repeat_ns:
            return b""
        self._repeat_ns = now_ns + REPEAT_NS
        self._sendings += 1
        return b"\0" + encode(self._queue[0])

    def answered(self, reply: Reply) -> Request | None:
        """The request that `reply` ends; None where it answers an earlier sending of what was answered already."""
        if not self._queue:
            return None
        first = self._queue[0]
        if (first.request_id, first.verb) != (reply.request_id, reply.request_type):
            return None
        self._repeat_ns = self._sendings = 0
        return self._queue.popleft()

    def clear(self) -> None:
        """What was asked over a line that is gone."""
        self._queue.clear()
        self._repeat_ns = self._sendings = 0
