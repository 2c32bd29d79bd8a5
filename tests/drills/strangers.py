"""Programs by the thousand that connect to the daemon's sockets and then do nothing."""

from __future__ import annotations

import errno
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

# ZMTP 3.0 (RFC 23): signature, version 3.0, mechanism NULL, no server, filler; then READY and a subscription to all.
GREETING = b"\xff" + bytes(8) + b"\x7f" + b"\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)
METADATA = b"\x0bSocket-Type" + (3).to_bytes(4, "big") + b"SUB"
READY = b"\x04" + bytes([6 + len(METADATA)]) + b"\x05READY" + METADATA
SUBSCRIBE_TO_ALL = b"\x00\x01\x01"
GREETING_BYTES, HEAD_BYTES = len(GREETING), 2  # bytes of the other end's greeting, and before its READY
SILENT, SUBSCRIBED = b"", SUBSCRIBE_TO_ALL
FULL_FOR_S = 10.0  # a full queue of connections may stay full for this long before the door counts as closed


@contextmanager
def strangers(path: Path, count: int, says: bytes) -> Iterator[int]:
    """Connects up to `count` times, sends `says` after an introduction if it is not empty, and never reads. Yields how
    many were accepted."""
    with ExitStack() as held:
        let_in = 0
        for _ in range(count):
            stranger = held.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            if not _connected(stranger, path):
                break
            let_in += 1
            if says:
                introduce(stranger)
                stranger.sendall(says)
        yield let_in


def introduce(peer: socket.socket) -> None:
    """Greets, and waits until the other end is ready: libzmq hangs up on whoever subscribes before."""
    peer.sendall(GREETING + READY)
    head = _received(peer, GREETING_BYTES + HEAD_BYTES)
    _received(peer, head[-1])


def _received(peer: socket.socket, count: int) -> bytes:
    received = b""
    while len(received) < count:
        part = peer.recv(count - len(received))
        if not part:
            raise ConnectionResetError("the other end hung up amid its greeting")
        received += part
    return received


def _connected(stranger: socket.socket, path: Path) -> bool:
    """False if connections are refused."""
    stranger.settimeout(FULL_FOR_S)
    until = time.monotonic() + FULL_FOR_S
    while True:
        try:
            stranger.connect(str(path))
            return True
        except (FileNotFoundError, ConnectionRefusedError, TimeoutError):
            return False
        except OSError as error:
            if error.errno != errno.EAGAIN or time.monotonic() > until:
                return False
            time.sleep(1e-3)
