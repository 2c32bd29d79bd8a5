"""Locks an endpoint for one daemon: in ZeroMQ, a second bind to an ipc path silently takes it from the first."""

from __future__ import annotations

import fcntl
import os
import socket
import time
from pathlib import Path

CONNECT_S = 1.0
LOOK_S = 0.05  # `serving_pid` holds a lock for a moment
ANOTHER_PLACE = "name another place with FMFTS_BUS (ipc:///directory or tcp://127.0.0.1:port) or [bus] endpoint"


class BusError(Exception):
    """An endpoint of the bus cannot be served; the text says which one, why, and what to do."""


def socket_path(endpoint: str) -> Path | None:
    """The file of an ipc endpoint, None for other transports."""
    return Path(endpoint[len("ipc://") :]) if endpoint.startswith("ipc://") else None


class EndpointLock:
    """A lock beside an ipc socket, held until `release` or the end of the process.

    The file is not removed on release: otherwise two daemons could lock two files of the same name.
    """

    def __init__(self, endpoint: str) -> None:
        path = socket_path(endpoint)
        self._descriptor = -1 if path is None else _take(path, endpoint)

    def release(self) -> None:
        if self._descriptor >= 0:
            os.ftruncate(self._descriptor, 0)
            os.close(self._descriptor)
            self._descriptor = -1


def serving_pid(endpoint: str) -> int | None:
    """Process id of the daemon that serves an endpoint; 0: its pid is unknown. None: no daemon serves it.

    Raises BusError where this user may not read the lock.
    """
    path = socket_path(endpoint)
    if path is None:
        return 0 if _accepts(endpoint) else None
    try:
        with _lock_file(path).open("rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except BlockingIOError:
                text = file.read(32).strip()
                return int(text) if text.isdigit() else 0
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise BusError(
            f"cannot see whether a daemon serves {endpoint}: {_lock_file(path)}: {error.strerror}: run this as the "
            "daemon's user or a member of its group, or name another place with FMFTS_BUS"
        ) from error
    return None


def _accepts(endpoint: str) -> bool:
    """Does a program listen on a tcp endpoint? ZeroMQ's connect cannot tell: it waits until one does."""
    host, _, port = endpoint.removeprefix("tcp://").rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=CONNECT_S):
            return True
    except OSError:
        return False


def _lock_file(path: Path) -> Path:
    return path.with_name(f"{path.name}.lock")


def _take(path: Path, endpoint: str) -> int:
    try:
        descriptor = os.open(_lock_file(path), os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o660)
    except OSError as error:
        raise BusError(f"cannot serve {endpoint}: {_lock_file(path)}: {error.strerror}; {ANOTHER_PLACE}") from error
    if not _locked(descriptor):
        pid = os.read(descriptor, 32).decode(errors="replace").strip() or "unknown"
        os.close(descriptor)
        raise BusError(
            f"another fmfts-daemon (pid {pid}) serves {endpoint}: stop it, "
            "or give this one a place of its own with FMFTS_BUS=ipc:///another/directory"
        )
    os.ftruncate(descriptor, 0)
    os.write(descriptor, f"{os.getpid()}\n".encode())
    return descriptor


def _locked(descriptor: int) -> bool:
    until = time.monotonic() + LOOK_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            if time.monotonic() >= until:
                return False
            time.sleep(LOOK_S / 10)
