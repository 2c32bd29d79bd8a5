"""Waits for bytes. Meanwhile C reads frames from a board's line, judges them and publishes their contacts.

C takes over after a frame. Other packets on the line (a status, a reset board), a request, a recorder or a baseline
recording end that. Then the source's `poll` reads the bytes, and Python passes each frame to C.
"""

from __future__ import annotations

import ctypes
import importlib
import logging
import select
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import zmq

from fmfts.bus.publisher import Publisher
from fmfts.pipeline import _pad
from fmfts.runtime.channel import Channel
from fmfts.runtime.failure import Contained
from fmfts.runtime.guarded import GuardedSource
from fmfts.sensor import ByteSource, Source, SourceError
from fmfts.sensor.patience import BEHIND, IN_TIME, RECORDED

log = logging.getLogger(__name__)


@dataclass(slots=True)
class LentBoard:
    """A board's channels. descriptor: set while C reads it."""

    source: ByteSource
    channels: Sequence[Channel]
    descriptor: int | None = None


class FastLoop:
    """epoll loop. Between begin() and end() C owns the board and its pads; do not use them from Python."""

    def __init__(self, publisher: Publisher) -> None:
        self._epoll = select.epoll()
        self._boards: dict[int, LentBoard] = {}  # by id of the source
        self._unserved: set[int] = set()  # descriptors where end() got back whole packets; the next wait() returns them
        self._offered: set[int] = set()  # descriptors of these that the last wait() returned
        self._loop = None
        send = send_function()
        if send is not None:
            self._loop = _pad.Loop(self._epoll.fileno(), send, publisher.address, IN_TIME, BEHIND)

    def add(self, source: Source, channels: Sequence[Channel]) -> None:
        """Allow C to handle this source's frames, if it is a ByteSource."""
        if self._loop is not None and isinstance(source, ByteSource):
            self._boards[id(source)] = LentBoard(source, channels)

    def register(self, descriptor: int) -> None:
        self._epoll.register(descriptor, select.EPOLLIN)

    def unregister(self, descriptor: int) -> None:
        self._epoll.unregister(descriptor)

    def wait(self, until_ns: int) -> list[int]:
        """Wait for descriptors with something that Python must read, and return them; none after `until_ns`."""
        if self._loop is not None:
            unserved, self._unserved = self._unserved, set()
            self._offered = unserved
            return [*unserved.union(self._loop.wait(0 if unserved else until_ns))]
        timeout_s = max(0.0, (until_ns - time.monotonic_ns()) * 1e-9)
        return [descriptor for descriptor, _ in self._epoll.poll(timeout_s)]

    def left_waiting(self, descriptors: Iterable[int | None]) -> None:
        """Remember descriptors that wait() returned but nobody read: packets in memory do not wake epoll."""
        self._unserved |= self._offered & {descriptor for descriptor in descriptors if descriptor is not None}

    def begin(self, source: Source, now_ns: int) -> None:
        """Let C handle the source's frames from now on, if that is possible."""
        line = self._boards.get(id(source))
        if line is None or self._loop is None or not (lendable := line.source.lendable()):
            return
        channels = [channel for channel in line.channels if channel.pad_index in lendable]
        pads = tuple(pad for channel in channels if (pad := channel.begin(now_ns)) is not None)
        if pads:
            with Contained(partial(self._not_begun, line)):
                descriptor, unread = line.source.lend()
                self._loop.begin(descriptor, unread, pads)
                line.descriptor = descriptor
                self._unserved.discard(descriptor)

    def _not_begun(self, line: LentBoard, error: BaseException) -> None:
        """Python continues with the frames. A source whose data C cannot read is closed."""
        for channel in line.channels:
            channel.end()
        if isinstance(error, SourceError):
            return
        if not isinstance(line.source, GuardedSource):
            raise error
        line.source.fail("lend", error)

    def end(self, source: Source) -> bool:
        """Take the source back from C, and count the frames that C handled.

        False if C left no bytes to Python.
        """
        line = self._boards.get(id(source))
        if line is None or self._loop is None:
            return True
        in_time = RECORDED if any(channel.wants_all for channel in line.channels) else IN_TIME
        line.source.patience = BEHIND if self._loop.is_behind() and in_time is IN_TIME else in_time
        if line.descriptor is None:
            return True
        returned = self._loop.end(line.descriptor)
        assert returned is not None
        unread, heard_ns, left_out, is_to_be_read = returned
        if b"\0" in unread:
            self._unserved.add(line.descriptor)
        line.source.give_back(unread, heard_ns, left_out)
        for channel in line.channels:
            if (number := channel.end()) is not None:
                line.source.passed(channel.pad_index, number)
        line.descriptor = None
        return bool(is_to_be_read)

    def end_recorded(self, now_ns: int) -> None:
        """Take back the sources whose frames somebody records: Python must see them."""
        for line in self._boards.values():
            if line.descriptor is not None and any(channel.recorders.are_there(now_ns) for channel in line.channels):
                self.end(line.source)

    def end_all(self) -> None:
        """Take all sources back from C. Each begins again when it is next served."""
        for line in self._boards.values():
            self.end(line.source)

    @contextmanager
    def ended(self, source: Source, now_ns: int) -> Iterator[bool]:
        """Within this context Python may use the source and its pads; afterwards C may take over again.

        Yields what `end` returns.
        """
        yield self.end(source)
        self.begin(source, now_ns)

    def close(self) -> None:
        self.end_all()
        self._epoll.close()


def send_function() -> int | None:
    """Address of `zmq_send` in the libzmq that pyzmq loaded. None if not found: then Python handles every frame."""
    for name in ("_zmq", "socket"):  # since pyzmq 26, and before
        try:
            library = importlib.import_module(f"zmq.backend.cython.{name}").__file__
            # This also finds the symbols of libzmq, to which the module is linked.
            return ctypes.cast(ctypes.CDLL(library).zmq_send, ctypes.c_void_p).value
        except (ImportError, OSError, AttributeError) as error:
            log.debug("no zmq_send through zmq.backend.cython.%s: %s", name, error)
    log.warning("pyzmq %s shows no zmq_send, so every frame goes through Python, at some 100 µs more", zmq.__version__)
    return None
