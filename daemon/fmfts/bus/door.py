"""Bounds how many programs may be connected: each costs memory, and libzmq aborts the process when it can open no more
files.

Its ipc listener takes EMFILE of accept(2) for an error of its own program (libzmq 4.3.5, `ipc_listener.cpp`). Its tcp
listener does not, but then the daemon can open no more devices and files. No option bounds the connections. So the
doors are closed long before: an ipc socket's file gets another name, and the kernel drops what asks for a new tcp
connection (listener.py). Connected peers stay; the ZeroMQ of all others tries again until the doors open.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial

from fmfts.bus.lock import BusError
from fmfts.bus.server import BoundSocket
from fmfts.service import open_files
from fmfts.service.realtime import RealtimeError, take_thread_priority

# The unit gives the daemon 2 GiB (MemoryMax). It takes 100 MB itself, and unread.py keeps 20 MB. At most 3 MB are kept
# for a peer that reads nothing: on the bus PEER_BYTES and 0.2 MB in the kernel; at the control socket 32 answers (1.6
# MB for the statuses of 64 pads) and 1 MB of requests that wait. A flood of 25,000 connections a second brings 125 more
# before the next look. So (512 + 125) * 3 MB + 120 MB = 2031 MB are less than 2 GiB = 2147 MB.
# A controller, a view and a recorder of each of 64 pads are 192 connections at least.
MOST_CONNECTIONS = 512
MOST_OF_A_CONNECTION = 3_000_000
OF_THE_DAEMON = 120_000_000
SHARE_OF_LIMIT = 2
# A program that does nothing else connects 25,000 times a second (measured; libzmq's thread is then as busy).
MEASURED_PER_S = 25_000.0
FASTEST_PER_S = 2 * MEASURED_PER_S
LONGEST_LOOK_S = 0.005  # while the door is nearly full or closed
# Below this limit a flood of connections might exceed it between two looks. Linux' own hard limit is at least 4096.
SAFE_LIMIT = 4096

log = logging.getLogger(__name__)


class Door:
    """Looks at the number of open files, in a thread of its own, and closes or opens the doors of `sockets`.

    limit: how many files this process may open. priority: real-time priority of the thread, 0: none. Raises BusError
    where the daemon's own files leave none for a connection.
    """

    def __init__(self, sockets: Sequence[BoundSocket], limit: int, priority: int = 0) -> None:
        paths = [socket.path for socket in sockets if socket.path is not None]
        self._paths = [(path, path.with_name(f"{path.name}.full")) for path in paths]
        self._listeners = [socket.listener for socket in sockets if socket.listener is not None]
        own = open_files.count()
        self._most = min(own + MOST_CONNECTIONS, limit // SHARE_OF_LIMIT)
        if self._most <= own:
            raise BusError(
                f"this process may open only {limit} files, and must have more than {SHARE_OF_LIMIT} times the {own} "
                f"that it needs without a client: raise the limit (ulimit -n {SAFE_LIMIT}; a service: LimitNOFILE=)"
            )
        self._priority = priority
        self._look_s = min((limit - self._most) / FASTEST_PER_S, LONGEST_LOOK_S)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="door", daemon=True)
        self.is_open = True
        self._stuck: list[str] = []  # reasons why a socket could not be closed or opened
        if limit < SAFE_LIMIT:
            log.warning(
                "this process may open only %d files, so many connections within %.0f ms could end it: raise the limit "
                "(ulimit -Hn; a service: LimitNOFILE=)",
                limit,
                self._look_s * 1e3,
            )
        self._thread.start()

    def close(self) -> None:
        """Stop looking; the caller closes the sockets."""
        self._ended.set()
        self._thread.join()
        for _, full in self._paths:
            full.unlink(missing_ok=True)

    def look(self) -> float:
        """Close the door if too many are connected, open it when a tenth of them has left. Returns the seconds to the
        next look, before which no flood can open more than after the longest look at a door that is nearly full."""
        opened = open_files.count()
        if opened >= self._most:
            self._set_open(False, opened)
        elif opened < 0.9 * self._most:
            self._set_open(True, opened)
        return self._look_s + max(self._most - opened, 0) / FASTEST_PER_S

    def _set_open(self, is_open: bool, opened: int) -> None:
        if is_open == self.is_open and not self._stuck:
            return
        moves = list(self._moves(is_open))
        stuck = [str(error) for move in moves if (error := _error_of(move)) is not None]
        if stuck and stuck != self._stuck:  # not at each look, which tries again
            log.error("the bus cannot be %s to new programs: %s", "opened" if is_open else "closed", "; ".join(stuck))
        if is_open != self.is_open and is_open:
            log.info("programs may connect to the bus again")
        elif is_open != self.is_open and len(stuck) < len(moves):
            log.warning(
                "%d connections and files are open: no other program may connect to the bus until some leave; "
                "`ss -xp` (tcp: `ss -tp`) shows who they are",
                opened,
            )
        self._stuck = stuck
        self.is_open = is_open

    def _moves(self, is_open: bool) -> Iterator[Callable[[], object]]:
        """One for each socket."""
        for path, full in self._paths:
            yield partial((full if is_open else path).rename, path if is_open else full)
        for listener in self._listeners:
            yield partial(listener.let_in, is_open)

    def _watch(self) -> None:
        if self._priority:
            with suppress(RealtimeError):  # the daemon requests the same, and reports why it is refused
                take_thread_priority(self._priority)
        failure, wait_s = "", self._look_s
        while not self._ended.wait(wait_s):
            try:
                wait_s = self.look()
            except Exception as error:  # nobody else would close the door
                wait_s = self._look_s
                if str(error) != failure:
                    failure = str(error)
                    log.exception("the connections cannot be bounded now (%s); this is tried again", error)


def _error_of(move: Callable[[], object]) -> OSError | None:
    try:
        move()
    except FileNotFoundError:
        return None  # somebody removed the socket's file, so nobody can connect; or it is moved already
    except OSError as error:
        return error
    return None
