"""Receives the bus once for all open pages, and keeps for each page what it has not been sent yet."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Sequence

import msgpack  # type: ignore[import-untyped]
import zmq

from fmfts_client import EndpointError, Endpoints
from fmfts_client.clock import SenderClock
from fmfts_client.keys import show_key
from fmfts_client.subscription import LARGEST_MESSAGE

TOPICS = (b"contact/", b"event/", b"status/")
GHOST, CAPTION = b"ghost/", b"caption/"
RECEIVED_AT_MOST = 20_000  # 1.4 s of 64 pads at 220 Hz; ZeroMQ drops what is beyond
KEPT_FOR_A_PAGE = 2_000  # 9 s of a pad at 220 Hz, for a browser that does not read


class Viewer:
    """Messages to send to one page: every message of the pad in `detail`, of other pads the newest contact."""

    def __init__(self) -> None:
        self.detail: bytes | None = None  # topic
        self.hidden = False  # a tab in the background needs no contacts
        self.left_out = 0
        self._newest: dict[bytes, bytes] = {}
        self._in_order: deque[tuple[bytes, bytes]] = deque()

    def take(self, topic: bytes, body: bytes) -> None:
        """Keep a message that must not be merged with a later one."""
        if len(self._in_order) == KEPT_FOR_A_PAGE:
            self._in_order.popleft()
            self.left_out += 1
        self._in_order.append((topic, body))

    def take_newest(self, contacts: dict[bytes, bytes]) -> None:
        """Keep the newest contact of each pad, which replaces the previous one."""
        if not self.hidden:
            self._newest.update(contacts)

    def forget(self) -> None:
        """Drop all kept messages."""
        self._newest.clear()
        self._in_order.clear()

    def batch(self) -> bytes:
        """All that is kept, as a sequence of MessagePack values: topic, body, topic, body …; empty if there is none."""
        if self.detail is not None:
            self._newest.pop(self.detail, None)
        parts = [part for topic, body in self._in_order for part in (packed_topic(topic), body)]
        parts += [part for topic, body in self._newest.items() for part in (packed_topic(topic), body)]
        self._in_order.clear()
        self._newest.clear()
        return b"".join(parts)


class Feed:
    """One subscription for all viewers. Without a viewer it is subscribed to nothing, and costs nothing.

    beside: endpoints of other programs, with `ghost/<pad>` (fmfts_page.ghost), or `caption/` {text} of a demo.
    Raises EndpointError.
    """

    def __init__(self, endpoints: Endpoints, beside: Sequence[str] = ()) -> None:
        self.viewers: set[Viewer] = set()
        self._socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.SUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, LARGEST_MESSAGE)
        self._socket.setsockopt(zmq.RCVHWM, RECEIVED_AT_MOST)
        try:
            show_key(self._socket, endpoints.bus, endpoints.key)
        except EndpointError:
            self._socket.close()
            raise
        self._clock = SenderClock() if endpoints.bus.startswith("tcp://") else None
        self._topics = (*TOPICS, GHOST, CAPTION) if beside else TOPICS
        self._socket.connect(endpoints.bus)
        for endpoint in beside:
            try:
                self._socket.connect(endpoint)
            except zmq.ZMQError as error:
                self._socket.close()
                raise EndpointError(
                    f"cannot connect to {endpoint!r} ({error.strerror}): give the other program's own endpoint, such "
                    "as ipc:///directory/socket or tcp://127.0.0.1:port"
                ) from error

    def add(self, viewer: Viewer) -> None:
        if not self.viewers:
            for topic in self._topics:
                self._socket.subscribe(topic)
        self.viewers.add(viewer)

    def remove(self, viewer: Viewer) -> None:
        self.viewers.discard(viewer)
        if not self.viewers:
            for topic in self._topics:
                self._socket.unsubscribe(topic)
            for _ in self._received():
                pass

    def drain(self) -> None:
        """Receive all that has arrived, and give it to the viewers."""
        newest: dict[bytes, bytes] = {}
        watched: dict[bytes, list[Viewer]] = {}
        for viewer in self.viewers:
            if viewer.detail is not None and not viewer.hidden:
                watched.setdefault(viewer.detail, []).append(viewer)
        for topic, body in self._received():
            if topic.startswith((b"contact/", GHOST)):
                newest[topic] = body
                for viewer in watched.get(topic, ()):
                    viewer.take(topic, body)
            else:
                for viewer in self.viewers:
                    viewer.take(topic, body)
        for viewer in self.viewers:
            viewer.take_newest(newest)
        if self._clock is not None and newest:
            self._set_clock(next(iter(newest.values())))

    def now_ns(self) -> int | None:
        """The time on the daemon's clock; None while it is not known (over tcp it takes 0.3 s of messages)."""
        if self._clock is None:
            return time.monotonic_ns()
        ahead_s = self._clock.ahead_s
        return None if ahead_s is None else time.monotonic_ns() - round(ahead_s * 1e9)

    def close(self) -> None:
        self._socket.close()

    def _received(self) -> Iterable[tuple[bytes, bytes]]:
        """Messages that have arrived. Their bodies are not decoded here: the page decodes and checks what it draws."""
        receive, again = self._socket.recv_multipart, zmq.Again
        for _ in range(RECEIVED_AT_MOST):
            try:
                parts = receive(zmq.NOBLOCK)
            except again:
                return
            if len(parts) == 2 and is_map(parts[1]):
                yield parts[0], parts[1]

    def _set_clock(self, body: bytes) -> None:
        try:
            message = msgpack.unpackb(body)
            boot, sent_ns = message["boot"], message["t_publish_ns"]
        except (KeyError, TypeError, ValueError, msgpack.UnpackException):
            return  # another version's message: the page says so
        if self._clock is not None and isinstance(boot, str) and isinstance(sent_ns, int):
            self._clock.take(boot, sent_ns * 1e-9, time.monotonic())


def packed_topic(topic: bytes) -> bytes:
    packed: bytes = msgpack.packb(topic.decode(errors="replace"))
    return packed


def is_map(body: bytes) -> bool:
    """Does a MessagePack map begin here? The decoder checks the rest."""
    return bool(body) and (0x80 <= body[0] <= 0x8F or body[0] in (0xDE, 0xDF))
