"""Keeps answers for peers that ask and do not read. Their cost is bounded, and no other peer waits for them.

ZeroMQ holds the first answers for a peer (`send_high_mark`). Beyond them the daemon refuses each request with a short
sentence, which waits here. A peer with MOST_OF_A_PEER bytes of them has stopped reading: later ones are dropped, and
logged.
"""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Callable
from itertools import islice

from fmfts.bus.server import PEER_BYTES

# Bytes. A refusal takes 0.5 kB.
MOST_OF_A_PEER = PEER_BYTES
MOST_IN_ALL = 20_000_000
OF_AN_ANSWER = 300  # Python's objects around the bytes of an answer
PEERS_AT_ONCE = 16  # peers to which one call tries to send: four tries take as long as a request

log = logging.getLogger(__name__)
Route = tuple[bytes, ...]
Answer = tuple[Route, bytes]


class Unread:
    """is_sent: sends an answer, or returns False if the peer reads nothing now."""

    def __init__(self, is_sent: Callable[[Answer], bool]) -> None:
        self._is_sent = is_sent
        self._kept: dict[bytes, deque[Answer]] = {}  # by peer; the first to be tried next
        self._bytes: Counter[bytes] = Counter()  # by peer
        self._in_all = self._dropped = 0

    def of(self, route: Route) -> int:
        """How many answers wait here for this peer."""
        return len(self._kept.get(route[0], ()))

    def keep(self, answer: Answer) -> None:
        peer, size = answer[0][0], _size(answer)
        if self._in_all + size > MOST_IN_ALL or self._bytes[peer] + size > MOST_OF_A_PEER:
            self._drop()
            return
        self._kept.setdefault(peer, deque()).append(answer)
        self._bytes[peer] += size
        self._in_all += size

    def deliver_one(self) -> bool:
        """Send one answer to one of the next PEERS_AT_ONCE peers. False if none of them reads; others have their turn
        in the next call."""
        for peer in list(islice(self._kept, PEERS_AT_ONCE)):
            answers = self._kept.pop(peer)
            sent = self._is_sent(answers[0])
            if sent:
                size = _size(answers.popleft())
                self._bytes[peer] -= size
                self._in_all -= size
            if answers:
                self._kept[peer] = answers
            else:
                del self._bytes[peer]
            if sent:
                return True
        return False

    def _drop(self) -> None:
        self._dropped += 1
        if self._dropped == 1 or self._dropped % 10_000 == 0:
            log.warning(
                "%d answer(s) were dropped: a program on the control socket sends requests and does not read the "
                "answers; `ss -xp` (tcp: `ss -tp`) shows who is connected",
                self._dropped,
            )


def _size(answer: Answer) -> int:
    """Bytes that it takes here."""
    route, payload = answer
    return len(payload) + sum(map(len, route)) + OF_AN_ANSWER
