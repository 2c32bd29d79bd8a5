"""Receives a gauge's lines over UDP, from the configured sender or, on this machine, from the same user alone.

Any local user can send to a port of this machine, and a forged force would let the machine press on. On the loopback
interface the kernel's table of sockets names the owner of the sender's socket, while that is open. In a network only
the address can be compared, and a machine there may forge it.
"""

from __future__ import annotations

import errno
import os
import socket
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from fmfts_collect.errors import AbsentError
from fmfts_collect.settings import UdpGauge

LARGEST_DATAGRAM = 512
MOST_LINES = 16  # of a datagram
MOST_AT_ONCE = 64  # datagrams read in one poll; the kernel keeps about 300 unread ones
LONGEST_POLL_NS = 20_000_000  # longest work in one poll; the rest waits
FLOODED_NS = 100_000_000  # an error if polls find more than that for this long: a gauge sends at most 1000 a second
OWNERS_NS = 50_000_000  # the table of sockets is read again after this time
TABLES = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
MOST_SOCKETS = 2000
LONGEST_READ_NS = 20_000_000  # longest work: any user can open sockets, and meanwhile nothing watches the force limit
AT_ONCE = 1 << 14  # bytes of a table that are read between two looks at the clock
EVERY_ADDRESS = b"0" * 8
ROOT = 0

WorkClock = Callable[[], int]  # nanoseconds that this thread has worked, without the time that other processes took


class Datagrams:
    """Lines that arrive at a UDP port. `refused`: what was dropped last, and why it is not the gauge's."""

    def __init__(self, config: UdpGauge, worked_ns: WorkClock = time.thread_time_ns) -> None:
        """Raises AbsentError where the port cannot be opened."""
        self.description = f"the gauge at UDP {config.address}:{config.port}"
        self.refused = ""
        self._host, _, self._port = config.sender.partition(":")
        self._full_since_ns: int | None = None
        # Without a sender the port is on the loopback interface (settings.py).
        self._worked_ns = worked_ns
        self._owners = Owners(worked_ns) if not self._host or _is_of_this_machine(self._host) else None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((config.address, config.port))
        except OSError as error:
            self._socket.close()
            raise AbsentError(f"gauge: cannot listen on UDP {config.address}:{config.port}: {error}") from error

    def take(self, now_ns: int) -> list[str]:
        """The lines of at most MOST_AT_ONCE datagrams, fewer after LONGEST_POLL_NS.

        Raises AbsentError while the port is flooded.
        """
        lines: list[str] = []
        end_ns = self._worked_ns() + LONGEST_POLL_NS
        for _ in range(MOST_AT_ONCE):
            try:
                data, (host, port) = self._socket.recvfrom(LARGEST_DATAGRAM + 1)
            except BlockingIOError:
                self._full_since_ns = None
                return lines
            why = self._why_not(len(data), host, port, now_ns)
            if why:
                self.refused = f"a datagram from {host}:{port} was not read, because {why}"
            else:
                lines += data.decode("ascii", "replace").splitlines()[:MOST_LINES]
            if self._worked_ns() > end_ns:
                break
        self._require_no_flood(now_ns, f"{host}:{port}")
        return lines

    def close(self) -> None:
        self._socket.close()

    def _why_not(self, size: int, host: str, port: int, now_ns: int) -> str:
        """Why a datagram of this size and sender is not read; "" where it is."""
        if self._host and (host != self._host or self._port not in ("", str(port))):
            return "collect.gauge.sender names another"
        if size > LARGEST_DATAGRAM:
            return f"it is longer than {LARGEST_DATAGRAM} bytes"
        return "" if self._owners is None else self._owners.why_not(port, now_ns)

    def _require_no_flood(self, now_ns: int, last: str) -> None:
        if self._full_since_ns is None:
            self._full_since_ns = now_ns
        elif now_ns - self._full_since_ns > FLOODED_NS:
            raise AbsentError(
                f"{self.description} is flooded with datagrams, the last from {last}, and the force may be lost among "
                f"them: end the program that sends them (`ss -uap` shows it). {self.refused}".rstrip()
            )


class Owners:
    """Finds whose socket sends from this machine; this user and root are trusted.

    Every socket with the sender's port counts, whatever its address: a socket on 127.0.0.2 may send as 127.0.0.1
    (IP_PKTINFO). It may be closed before it is looked up, so one socket must have the port at all addresses: while it
    is open, Linux gives the port to nobody else, unless both ask for that (SO_REUSEADDR).
    """

    def __init__(self, worked_ns: WorkClock = time.thread_time_ns) -> None:
        self._allowed = {os.geteuid(), ROOT}
        self._worked_ns = worked_ns
        self._of_port: dict[int, set[int]] = {}
        self._unshared: set[int] = set()
        self._unreadable = ""
        self._read_ns: int | None = None

    def why_not(self, port: int, now_ns: int) -> str:
        """Why the sockets with this port are not trusted; "" where they are."""
        if self._read_ns is None or now_ns - self._read_ns > OWNERS_NS:
            self._unreadable, self._read_ns = "", now_ns
            try:
                self._of_port, self._unshared = _owners_by_port(self._worked_ns)
            except (OSError, ValueError) as error:
                self._unreadable = f"the kernel's table of sockets cannot be used to see whose it is: {error}"
        if self._unreadable:
            return self._unreadable
        owners = self._of_port.get(port)
        if not owners:
            return (
                "this machine does not show whose it is: let the program that sends keep one socket open, and see that "
                "it runs on this machine, outside of a container"
            )
        strangers = owners - self._allowed
        if strangers:
            return (
                f"another user's program (uid {min(strangers)}) has a socket with that port: end it, or run it as this "
                "user"
            )
        return (
            ""
            if port in self._unshared
            else "another user's program could share that port: let the program send from an IPv4 socket that is "
            "neither connected nor bound to an address"
        )


def _owners_by_port(worked_ns: WorkClock) -> tuple[dict[int, set[int]], set[int]]:
    """The users of each local port, and the ports that one socket has at all IPv4 addresses.

    Raises OSError or ValueError where not all sockets can be read soon enough.
    """
    owners: dict[int, set[int]] = {}
    unshared: set[int] = set()
    sockets, end_ns = 0, worked_ns() + LONGEST_READ_NS
    for path in TABLES:
        try:
            table = path.open("rb")
        except FileNotFoundError:  # a kernel without IPv6
            continue
        with table:
            next(table, None)  # the heading
            while lines := table.readlines(AT_ONCE):
                sockets += len(lines)
                if sockets > MOST_SOCKETS:
                    raise ValueError(f"it has more than {MOST_SOCKETS} sockets (`ss -uap` shows whose they are)")
                for line in lines:
                    _, local, _, _, _, _, _, owner, *_ = line.split()
                    address, _, digits = local.partition(b":")
                    port = int(digits, 16)
                    owners.setdefault(port, set()).add(int(owner))
                    if address == EVERY_ADDRESS:
                        unshared.add(port)
                if worked_ns() > end_ns:
                    raise ValueError(f"reading it takes longer than {LONGEST_READ_NS / 1e6:g} ms")
    return owners, unshared


def _is_of_this_machine(host: str) -> bool:
    """Only an address of this machine can be bound."""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        try:
            probe.bind((host, 0))
        except OSError as error:
            return error.errno != errno.EADDRNOTAVAIL
    return True
