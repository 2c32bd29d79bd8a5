"""Ports for servers of the tests over tcp; tests that run side by side never get the same."""

from __future__ import annotations

import os
import socket
import time
from itertools import count

# Below 32768, where Linux begins to give ports to whoever connects.
FIRST, BASES, BASES_OF_A_PROCESS, PORTS_OF_A_BASE = 20_000, 3_000, 37, 4
PATIENCE_S = 30.0
_asked = count()


def tcp_base() -> str:
    """A bus's base on four free ports in a row: bus, control, frames and joints."""
    for _ in range(BASES_OF_A_PROCESS):
        number = os.getpid() * BASES_OF_A_PROCESS + next(_asked) % BASES_OF_A_PROCESS
        first = FIRST + PORTS_OF_A_BASE * (number % BASES)
        if all(map(_is_free, range(first, first + PORTS_OF_A_BASE))):
            return f"tcp://127.0.0.1:{first}"
    raise AssertionError("no ports are free")


def wait_until_free(base: str) -> None:
    """ZeroMQ closes a socket in a thread of its own, some time after `close`."""
    first = int(base.rpartition(":")[2])
    until = time.monotonic() + PATIENCE_S
    while not all(map(_is_free, range(first, first + PORTS_OF_A_BASE))):
        assert time.monotonic() < until, f"another program has a port from {first} on"
        time.sleep(0.01)


def free_udp_port() -> int:
    """Not one that the kernel would give to another program meanwhile."""
    for _ in range(BASES_OF_A_PROCESS):
        port = int(tcp_base().rpartition(":")[2])
        if _is_free(port, socket.SOCK_DGRAM):
            return port
    raise AssertionError("no ports are free")


def _is_free(port: int, kind: int = socket.SOCK_STREAM) -> bool:
    with socket.socket(socket.AF_INET, kind) as attempt:
        if kind == socket.SOCK_STREAM:  # like ZeroMQ: a port that was just closed will do
            attempt.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            attempt.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True
