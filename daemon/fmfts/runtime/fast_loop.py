"""The wait for bytes, and healthy frames that pass meanwhile in C: from a board's line to the bus, without Python.

A board's frames pass from a healthy one on. Whatever else comes (a fault, a status) or is asked for ends that: `poll`
reads then, and the stages in Python judge.
"""

from __future__ import annotations

import ctypes
import importlib
import logging
import select
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import zmq

from fmfts.bus.publisher import Publisher
from fmfts.pipeline.fast.compiled import AVAILABLE, _fast
from fmfts.runtime.channel import Channel
from fmfts.sensor import ByteSource, Source

log = logging.getLogger(__name__)


@dataclass(slots=True)
class Line:
    """A board's channels; the descriptor while frames of some of them pass."""

    source: ByteSource
    channels: Sequence[Channel]
    descriptor: int | None = None


class Express:
    """Waits for descriptors; frames of boards that began pass meanwhile. Touch neither board nor pads until `end`."""

    def __init__(self, publisher: Publisher) -> None:
        self._epoll = select.epoll()
        self._lines: dict[int, Line] = {}  # by id of the source
        self._left: set[int] = set()  # descriptors of those that ended with whole packets unread
        self._loop = None
        send = send_function() if AVAILABLE else None
        if send is not None:
            self._loop = _fast.Loop(self._epoll.fileno(), send, publisher.address)

    def take_in(self, source: Source, channels: Sequence[Channel]) -> None:
        """A source whose frames may pass, if it is one of bytes."""
        if self._loop is not None and isinstance(source, ByteSource):
            self._lines[id(source)] = Line(source, channels)

    def register(self, descriptor: int) -> None:
        self._epoll.register(descriptor, select.EPOLLIN)

    def unregister(self, descriptor: int) -> None:
        self._epoll.unregister(descriptor)

    def wait(self, until_ns: int) -> list[int]:
        """Descriptors with something that no lane takes, as soon as there are any; none at `until_ns`."""
        if self._loop is not None:
            left, self._left = self._left, set()
            return [*left.union(self._loop.wait(0 if left else until_ns))]
        timeout_s = max(0.0, (until_ns - time.monotonic_ns()) * 1e-9)
        return [descriptor for descriptor, _ in self._epoll.poll(timeout_s)]

    def begin(self, source: Source, now_ns: int) -> None:
        """Let frames pass from now on, if they can."""
        line = self._lines.get(id(source))
        if line is None or self._loop is None or not (pads := line.source.lendable()):
            return
        welcome = [channel for channel in line.channels if channel.pad_index in pads]
        lanes = tuple(lane.compiled for channel in welcome if (lane := channel.begin(now_ns)) is not None)
        if lanes:
            line.descriptor, unread = line.source.lend()
            self._left.discard(line.descriptor)
            self._loop.begin(line.descriptor, unread, lanes)

    def end(self, source: Source) -> None:
        """Let none pass, and account for those that have."""
        line = self._lines.get(id(source))
        if line is None or line.descriptor is None or self._loop is None:
            return
        left = self._loop.end(line.descriptor)
        assert left is not None
        if b"\0" in left[0]:
            self._left.add(line.descriptor)
        line.source.give_back(*left)
        for channel in line.channels:
            channel.end()
        line.descriptor = None

    def end_all(self) -> None:
        """Each begins again when it has been served."""
        for line in self._lines.values():
            self.end(line.source)

    @contextmanager
    def ended(self, source: Source, now_ns: int) -> Iterator[None]:
        """Let none pass meanwhile; it begins again with what was done to it."""
        self.end(source)
        yield
        self.begin(source, now_ns)

    def close(self) -> None:
        self.end_all()
        self._epoll.close()


def send_function() -> int | None:
    """Address of `zmq_send` in the libzmq that pyzmq has loaded; None where it cannot be had: no frame passes then."""
    for name in ("_zmq", "socket"):  # of pyzmq 26 and later, and before
        try:
            library = importlib.import_module(f"zmq.backend.cython.{name}").__file__
            # Symbols of what a library was linked with are found through it.
            return ctypes.cast(ctypes.CDLL(library).zmq_send, ctypes.c_void_p).value
        except (ImportError, OSError, AttributeError) as error:
            log.debug("no zmq_send through zmq.backend.cython.%s: %s", name, error)
    log.warning("pyzmq %s shows no zmq_send, so every frame goes through Python, at some 100 µs more", zmq.__version__)
    return None
