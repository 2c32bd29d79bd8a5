"""Keeps the list of the clients that may connect over the network: a file with `key name right`, one client a line.

A right is `may-change` or `read-only`. The first line is HEAD.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from zmq.utils import z85

from fmfts.bus.lock import BusError
from fmfts.common.reading import open_regular
from fmfts.service.state import give_to, write_atomically
from fmfts_client.keys import decoded

CLIENT_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")
LARGEST_LIST = 1 << 20
READABLE = 0o640
MAY_CHANGE, READ_ONLY = "may-change", "read-only"
HEAD = f"# key name right, which is {MAY_CHANGE} or {READ_ONLY}"


class KeysError(BusError):
    """A key or the list of keys is missing or damaged; the text names the file and what to do."""


class ClosedKeysError(KeysError):
    """This user cannot read a key or the list."""


@dataclass(frozen=True)
class Client:
    """A client on the list. public: its key, 32 bytes. may_change: may it record baselines and run self-tests?"""

    name: str
    public: bytes
    may_change: bool

    @property
    def right(self) -> str:
        return MAY_CHANGE if self.may_change else READ_ONLY


class ClientList:
    """The file at `path`. Raises KeysError where it cannot be read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._read_at: tuple[int, int, int] | None = None
        self._by_key: dict[bytes, Client] = {}
        self._damage = ""

    def read(self) -> dict[str, Client]:
        """The clients by their names."""
        try:
            with open_regular(self.path) as file:
                content = file.read(LARGEST_LIST + 1)
        except (OSError, ValueError) as error:
            raise unreadable(f"list of keys {self.path}", error) from error
        if len(content) > LARGEST_LIST:
            raise KeysError(f"list of keys {self.path}: larger than {LARGEST_LIST} bytes, so it is not a list of keys")
        clients: dict[str, Client] = {}
        seen: set[bytes] = set()
        for number, client in self._parsed(content.decode(errors="replace")):
            if client.name in clients or client.public in seen:
                raise KeysError(f"{self._line(number)}: this name or key is on a line above, too; remove one of them")
            clients[client.name] = client
            seen.add(client.public)
        return clients

    def write(self, clients: dict[str, Client]) -> None:
        """Replace the file. Raises OSError."""
        lines = (f"{z85.encode(one.public).decode()} {one.name} {one.right}\n" for one in clients.values())
        write_atomically(self.path, "".join([f"{HEAD}\n", *lines]).encode())

    def create(self) -> None:
        """Make an empty list, if there is none, which the folder's owner and group can read. Raises OSError."""
        with suppress(FileExistsError), self.path.open("xb") as file:
            os.fchmod(file.fileno(), READABLE)
            give_to(self.path.parent.stat(), file.fileno())

    def with_key(self, public: bytes) -> Client | None:
        """The client with this key (32 bytes); None: it is not on the list. Reads a list that has changed again."""
        try:
            status = self.path.stat()
        except (OSError, ValueError) as error:
            raise unreadable(f"list of keys {self.path}", error) from error
        version = status.st_mtime_ns, status.st_ctime_ns, status.st_ino
        if version != self._read_at:
            self._read_at, self._by_key, self._damage = None, {}, ""
            try:
                self._by_key = {client.public: client for client in self.read().values()}
            except KeysError as error:
                if error.__cause__ is not None:  # the file could not be opened or read: try again next time
                    raise
                self._damage = str(error)  # a damaged list is not read again for each peer that connects
            self._read_at = version
        if self._damage:
            raise KeysError(self._damage)
        return self._by_key.get(public)

    def _parsed(self, text: str) -> Iterator[tuple[int, Client]]:
        lines = text.splitlines()
        if lines and lines[0] != HEAD:
            raise KeysError(f"{self._line(1)}: this line must stand before it: {HEAD}")
        for number, line in enumerate(lines[1:], 2):
            key, _, rest = line.partition(" ")
            name, _, right = rest.partition(" ")
            public = decoded(key)
            if public is None or not CLIENT_NAME.fullmatch(name) or right not in (MAY_CHANGE, READ_ONLY):
                form = f"key name {MAY_CHANGE}` or `key name {READ_ONLY}"
                raise KeysError(f"{self._line(number)}: not `{form}`; remove it")
            yield number, Client(name, public, right == MAY_CHANGE)

    def _line(self, number: int) -> str:
        return f"list of keys {self.path}, line {number}"


def unreadable(what: str, error: OSError | ValueError) -> KeysError:
    """The error for a file of keys that cannot be read, with what to do."""
    if isinstance(error, FileNotFoundError):
        return KeysError(f"{what} is not there: `fmfts-daemon keys new NAME` makes what is missing")
    if isinstance(error, PermissionError):
        return ClosedKeysError(
            f"{what} is closed to this user: `sudo chown -R fmfts:` its folder, where fmfts is the service, or the "
            "user who runs the daemon"
        )
    return KeysError(f"{what} cannot be read: {getattr(error, 'strerror', None) or error}")
