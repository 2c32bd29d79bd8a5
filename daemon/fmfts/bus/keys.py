"""Keeps the daemon's key and the keys of its network clients, in a folder with the files `server.key` and `clients`."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import zmq
from zmq.utils import z85

from fmfts.bus.lock import BusError
from fmfts.common.writing import why_not_written
from fmfts.service.state import write_atomically
from fmfts_client.keys import KEY_CHARACTERS, BadKeyError, read_fields

CLIENT_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")
LARGEST_LIST = 1 << 20
PRIVATE, READABLE = 0o600, 0o640
ADVICE = "`fmfts-daemon keys new NAME` makes what is missing"


class NotWrittenError(BusError):
    """A key or the list of keys cannot be written."""


class OptionError(BusError):
    """A client's name that cannot be, is taken, or is not on the list."""


@dataclass(frozen=True)
class ServerKey:
    """The daemon's pair of CURVE keys, both in Z85."""

    public: bytes
    secret: bytes = field(repr=False)


class KeyFolder:
    """The folder that `[bus] keys` names. Raises BusError, with what to do, where it cannot be used."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._server = folder / "server.key"
        self._clients = folder / "clients"
        self._read_at: tuple[int, int] | None = None
        self._allowed: frozenset[bytes] = frozenset()

    def server(self) -> ServerKey:
        """The daemon's keys, read from `server.key`."""
        try:
            return ServerKey(*read_fields(self._server, ("public", "secret")))
        except BadKeyError as error:
            raise BusError(f"{error}; {ADVICE}") from error

    def clients(self) -> dict[str, bytes]:
        """Name → public key (32 bytes) of every client that may come in."""
        try:
            with self._clients.open("rb") as file:
                content = file.read(LARGEST_LIST + 1)
        except OSError as error:
            raise BusError(f"{self._clients}: {error.strerror}; {ADVICE}") from error
        if len(content) > LARGEST_LIST:
            raise BusError(f"{self._clients} is larger than {LARGEST_LIST} bytes: it is not a list of keys")
        return dict(self._parsed(content.decode(errors="replace")))

    def allows(self, public: bytes) -> bool:
        """May the client with this public key (32 bytes) connect? Reads the list again when it has changed."""
        status = self._clients.stat()
        if (status.st_mtime_ns, status.st_ino) != self._read_at:
            self._allowed = frozenset(self.clients().values())
            self._read_at = (status.st_mtime_ns, status.st_ino)
        return public in self._allowed

    def add(self, name: str, output: Path) -> None:
        """Make a key for a new client: write it to `output`, and its public half to the list.

        Makes the daemon's own key first where there is none.
        """
        if not CLIENT_NAME.fullmatch(name):
            raise OptionError(f"{name!r} is not a client's name: 1 to 64 letters, digits, dots, - or _")
        try:
            self.folder.mkdir(mode=0o750, parents=True, exist_ok=True)
            if not self._server.exists():
                public, secret = zmq.curve_keypair()
                _create(self._server, f"{_line('public', public)}{_line('secret', secret)}")
                self._clients.touch(READABLE)
            known = self.clients()
            if name in known:
                raise OptionError(f"there is a client {name!r} already: `fmfts-daemon keys forget {name}` first")
            public, secret = zmq.curve_keypair()
            head = f"# The key of fmfts client {name}: whoever has it is let in. FMFTS_KEY names this file.\n"
            lines = _line("server", self.server().public) + _line("public", public) + _line("secret", secret)
            _create(output, head + lines)
            self._write(known | {name: z85.decode(public)})
        except OSError as error:
            raise NotWrittenError(f"{error.filename}: {why_not_written(error)}") from error

    def forget(self, name: str) -> None:
        """Remove a client's key from the list. A client that is connected stays so until the daemon restarts."""
        known = self.clients()
        if known.pop(name, None) is None:
            raise OptionError(f"there is no client {name!r} in {self._clients}: {', '.join(known) or 'nobody'}")
        try:
            self._write(known)
        except OSError as error:
            raise NotWrittenError(f"{error.filename or self._clients}: {why_not_written(error)}") from error

    def _write(self, clients: dict[str, bytes]) -> None:
        text = "".join(f"{z85.encode(key).decode()} {name}\n" for name, key in clients.items())
        write_atomically(self._clients, text.encode())
        self._clients.chmod(READABLE)

    def _parsed(self, text: str) -> Iterator[tuple[str, bytes]]:
        for number, line in enumerate(text.splitlines(), 1):
            key, _, name = line.partition(" ")
            try:
                public = z85.decode(key) if len(key) == KEY_CHARACTERS else b""
            except (KeyError, ValueError, struct.error):  # struct.error: five characters beyond 32 bits
                public = b""
            if len(public) != 32 or not CLIENT_NAME.fullmatch(name):
                raise BusError(f"{self._clients}, line {number}: not `key name`; remove it")
            yield name, public


def _line(name: str, key: bytes) -> str:
    return f'{name} = "{key.decode()}"\n'


def _create(path: Path, text: str) -> None:
    """Writes a new file that only its owner can ever read; raises FileExistsError where the file exists."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, PRIVATE)
    with os.fdopen(descriptor, "w") as file:
        file.write(text)
