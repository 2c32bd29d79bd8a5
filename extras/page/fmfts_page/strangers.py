"""Bounds the connections that have not shown the token. They never replace a page that has.

Each counts from its acceptance by the kernel, before TLS. A new one takes the place of the oldest: a
program that opens a thousand silent connections cannot lock others out.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
from dataclasses import dataclass
from typing import Any

# A connection passes through at most eight turns of the loop until its token is known, so it is not among the oldest.
WAITING, ACCEPTED_IN_A_TURN = 512, 32
QUEUE = 256  # the kernel's queue until the loop accepts
Address = tuple[Any, ...]  # address of the other end: unique while the connection lasts


@dataclass
class Stranger:
    connection: socket.socket
    transport: asyncio.Transport | None = None  # None until the TLS handshake is done, if TLS is used

    @property
    def is_closed(self) -> bool:
        return self.connection.fileno() < 0

    def drop(self) -> None:
        if self.transport is not None:
            self.transport.abort()
        else:
            with contextlib.suppress(OSError):  # the other end was faster
                self.connection.shutdown(socket.SHUT_RDWR)  # asyncio sees the end and closes


class Strangers:
    """The connections without a token, in the order of their arrival."""

    def __init__(self) -> None:
        self._waiting: dict[Address, Stranger] = {}

    def came(self, connection: socket.socket, address: Address) -> None:
        """A new connection. Beyond WAITING the oldest is dropped."""
        self._waiting.pop(address, None)
        if len(self._waiting) >= WAITING:  # some may have ended before they had a transport
            self._waiting = {key: each for key, each in self._waiting.items() if not each.is_closed}
        if len(self._waiting) >= WAITING:
            self._waiting.pop(next(iter(self._waiting))).drop()
        self._waiting[address] = Stranger(connection)

    def speaks(self, transport: asyncio.Transport) -> None:
        """The connection has a transport now."""
        if (stranger := self._waiting.get(_other_end(transport))) is not None:
            stranger.transport = transport

    def left(self, transport: asyncio.Transport) -> None:
        """The connection has shown the token, or is closed."""
        stranger = self._waiting.get(_other_end(transport))
        if stranger is not None and stranger.transport is transport:
            del self._waiting[_other_end(transport)]


def _other_end(transport: asyncio.Transport) -> Address:
    address: Address = transport.get_extra_info("peername")
    return address


class Door(socket.socket):
    """A listening socket that reports each connection that asyncio accepts."""

    def __init__(self, family: int, address: Address, strangers: Strangers) -> None:
        """Raises OSError if the address cannot be bound."""
        super().__init__(family, socket.SOCK_STREAM)
        try:
            self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                self.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            self.bind(address)
        except OSError:
            self.close()
            raise
        self._strangers = strangers

    def accept(self) -> tuple[socket.socket, Address]:
        connection, address = super().accept()
        self._strangers.came(connection, address)
        return connection, address


def doors_of(host: str, port: int, strangers: Strangers) -> list[Door]:
    """A listening socket for each address of the host, all on one port. Raises OSError if that cannot be.

    An address that is not set up is passed over: `localhost` often has one of IPv6.
    """
    doors: list[Door] = []
    try:
        for family, _, _, _, address in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM):
            here = (address[0], doors[0].getsockname()[1] if doors else port, *address[2:])
            try:
                doors.append(Door(family, here, strangers))
            except OSError as error:
                if error.errno not in (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT):
                    raise
    except OSError:
        for door in doors:
            door.close()
        raise
    if not doors:
        raise OSError(errno.EADDRNOTAVAIL, "this computer has no such address")
    return doors
