"""Programs that send requests to the daemon as fast as they can: many peers in one process, which speaks ZMTP 3.0 (RFC
23) itself.

So 20,000 requests a second cost this process little, and only the daemon slows down. Prints one line of JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import socket
import sys
import time
from collections.abc import Sequence

import msgpack

from drills.strangers import GREETING

METADATA = b"\x0bSocket-Type" + (6).to_bytes(4, "big") + b"DEALER"
READY = b"\x04" + bytes([6 + len(METADATA)]) + b"\x05READY" + METADATA
GREETING_BYTES = 64
LONG, COMMAND = 0x02, 0x04  # bits of a frame's first byte
REFUSED = b"\xa5error\xd9"  # msgpack: the key, and a text of 32 to 255 bytes
STEP_S = 0.002
LAST_S = 30.0  # the last answers may take this long
LARGEST_READ = 1 << 20


class Flooder:
    """A peer. waiting: how many unanswered requests it may have.

    turns: how often it was to ask. held: how often most of its requests were then still unanswered or unsent.
    """

    def __init__(self, address: str, verb: str, waiting: int) -> None:
        body = msgpack.packb({"id": 1, "verb": verb})
        self.request = bytes([0, len(body)]) + body
        self.waiting = waiting
        self.asked = self.answered = self.refused = self.turns = self.held = 0
        self._unsent, self._unread = b"", bytearray()
        if address.startswith("ipc://"):
            self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self.socket.connect(address.removeprefix("ipc://"))
        else:
            host, _, port = address.removeprefix("tcp://").rpartition(":")
            self.socket = socket.create_connection((host, int(port)))
        self.socket.sendall(GREETING + READY)
        greeting = b""
        while len(greeting) < GREETING_BYTES:
            greeting += self.socket.recv(GREETING_BYTES - len(greeting))
        self.socket.setblocking(False)

    @property
    def unanswered(self) -> int:
        return self.asked - self.answered - self.refused

    def ask(self, count: int) -> None:
        """Send `count` requests, or fewer if `waiting` or the socket allows no more."""
        self.turns += 1
        self.held += bool(self._unsent) or self.unanswered > self.waiting / 2
        count = min(count, self.waiting - self.unanswered)
        if not self._unsent and count > 0:
            self._unsent = self.request * count
            self.asked += count
        if self._unsent:
            try:
                self._unsent = self._unsent[self.socket.send(self._unsent) :]
            except BlockingIOError:
                return

    def read(self) -> None:
        try:
            self._unread += self.socket.recv(LARGEST_READ)
        except BlockingIOError:
            return
        begin = 0
        while True:
            head = 9 if self._unread[begin : begin + 1] and self._unread[begin] & LONG else 2
            if len(self._unread) < begin + head:
                break
            size = int.from_bytes(self._unread[begin + 1 : begin + head], "big")
            if len(self._unread) < begin + head + size:
                break
            if not self._unread[begin] & COMMAND:
                self._count(self._unread[begin + head : begin + head + min(size, 64)])
            begin += head + size
        del self._unread[:begin]

    def _count(self, answer: bytearray) -> None:
        if b"\xa5error" not in answer:
            self.answered += 1
            return
        assert REFUSED in answer, f"a refusal without a sentence: {answer!r}"
        self.refused += 1


def flood(peers: Sequence[Flooder], per_s: float, seconds: float, reads: bool) -> int:
    """Ask `per_s` times a second in total; 0: as fast as the peers may. Without `reads`, all answers are read at the
    end.

    Returns when it began, in ns.
    """
    begun_ns = time.monotonic_ns()
    epoll = select.epoll()
    by_descriptor = {peer.socket.fileno(): peer for peer in peers}
    for descriptor in by_descriptor:
        epoll.register(descriptor, select.EPOLLIN)
    begun = time.monotonic()
    asked = 0
    while (passed := time.monotonic() - begun) < seconds:
        due = int(per_s * passed) - asked if per_s else sum(peer.waiting for peer in peers)
        for peer in peers:
            peer.ask(-(-due // len(peers)))
        asked += due
        if not reads or per_s:
            time.sleep(STEP_S)
        if reads:
            for descriptor, _ in epoll.poll(STEP_S):
                by_descriptor[descriptor].read()
    while any(peer.unanswered for peer in peers) and time.monotonic() - begun < seconds + LAST_S:
        for peer in peers:
            peer.ask(0)
        for descriptor, _ in epoll.poll(STEP_S):
            by_descriptor[descriptor].read()
    return begun_ns


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("address")
    parser.add_argument("--verb", default="pads")
    parser.add_argument("--peers", type=int, default=1)
    parser.add_argument("--waiting", type=int, default=1 << 30)
    parser.add_argument("--per-s", type=float, default=0.0)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--nice", type=int, default=19)
    parser.add_argument("--deaf", action="store_true", help="read nothing until the end")
    options = parser.parse_args()
    os.setpriority(os.PRIO_PROCESS, 0, options.nice)
    peers = [Flooder(options.address, options.verb, options.waiting) for _ in range(options.peers)]
    begun_ns = flood(peers, options.per_s, options.seconds, reads=not options.deaf)
    names = ("asked", "answered", "refused", "unanswered", "turns", "held")
    counts = {name: sum(getattr(peer, name) for peer in peers) for name in names}
    json.dump(counts | {"begun_ns": begun_ns}, sys.stdout)


if __name__ == "__main__":
    main()
