"""Receives a gauge's lines over UDP, from the configured sender or, on this machine, from the same user alone.

Any local user can send to a port of this machine, and a forged force would let the machine press on. On the loopback
interface the kernel's table of sockets says whose a sender's socket is, as long as the socket is open. In a network
only the address can be compared, and a machine there may forge it.
"""

from __future__ import annotations

import errno
import ipaddress
import os
import re
import socket
from contextlib import closing
from pathlib import Path

from fmfts.collect.errors import AbsentError
from fmfts.config.collect import UdpGauge

LARGEST_DATAGRAM = 512
MOST_LINES = 16  # of a datagram
MOST_AT_ONCE = 64  # datagrams of a poll; the rest waits in the kernel, which keeps about 300
FLOODED_NS = 100_000_000  # so long each poll had more than that: a gauge sends 1000 a second at most
OWNERS_NS = 50_000_000  # the table of sockets is read again after so long
TABLES = (Path("/proc/net/udp"), Path("/proc/net/udp6"))
LARGEST_TABLE = 1 << 20  # 8000 sockets
ROOT = 0


class Datagrams:
    """Lines that arrive at a UDP port; what is not from the gauge is dropped, and `refused` says why."""

    def __init__(self, config: UdpGauge) -> None:
        """Raises AbsentError where the port cannot be opened."""
        self.description = f"the gauge at UDP {config.address}:{config.port}"
        self.refused = ""
        self._host, _, self._port = config.sender.partition(":")
        self._full_since_ns: int | None = None
        # Without a sender the port is on the loopback interface (config/collect.py).
        self._owners = Owners() if not self._host or _is_of_this_machine(self._host) else None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((config.address, config.port))
        except OSError as error:
            self._socket.close()
            raise AbsentError(f"gauge: cannot listen on UDP {config.address}:{config.port}: {error}") from error

    def take(self, now_ns: int) -> list[str]:
        """The lines of at most MOST_AT_ONCE datagrams. Raises AbsentError while the port is flooded."""
        lines: list[str] = []
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
        return "" if self._owners is None else self._owners.why_not(host, port, now_ns)

    def _require_no_flood(self, now_ns: int, last: str) -> None:
        if self._full_since_ns is None:
            self._full_since_ns = now_ns
        elif now_ns - self._full_since_ns > FLOODED_NS:
            raise AbsentError(
                f"{self.description} is flooded with datagrams, the last from {last}, and the force may be lost among "
                f"them: end the program that sends them (`ss -uap` shows it). {self.refused}".rstrip()
            )


class Owners:
    """Finds whose socket sends from this machine; this user and root are trusted."""

    def __init__(self) -> None:
        self._allowed = {os.geteuid(), ROOT}
        self._tables = b""
        self._read_ns: int | None = None

    def why_not(self, host: str, port: int, now_ns: int) -> str:
        """Why the socket at this address is not trusted; "" where it is."""
        if self._read_ns is None or now_ns - self._read_ns > OWNERS_NS:
            self._tables, self._read_ns = b"".join(_beginning(path) for path in TABLES), now_ns
        # A socket that is bound to all addresses is listed as zeros, an IPv6 one with the IPv4 address at its end.
        address = bytes(reversed(ipaddress.IPv4Address(host).packed)).hex().upper().encode()
        entry = rb"\d+: (?:0{24}|0{16}F{4}0{4})?(?:%s|0{8}):%04X [0-9A-F]+:\S+ (?:\S+ +){4}(\d+) " % (address, port)
        owners = {int(owner) for owner in re.findall(entry, self._tables)}
        if not owners:
            return (
                "this machine does not show whose it is: let the program that sends keep one socket open, and see that "
                "it runs on this machine, outside of a container"
            )
        strangers = owners - self._allowed
        return (
            f"the program that sent it is another user's (uid {min(strangers)}): run it as this user"
            if strangers
            else ""
        )


def _is_of_this_machine(host: str) -> bool:
    """Only an address of this machine can be bound."""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        try:
            probe.bind((host, 0))
        except OSError as error:
            return error.errno != errno.EADDRNOTAVAIL
    return True


def _beginning(table: Path) -> bytes:
    try:
        with table.open("rb") as file:
            return file.read(LARGEST_TABLE)
    except OSError:
        return b""  # then no sender is known, and `why_not` says so
