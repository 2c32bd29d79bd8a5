"""Keeps the daemon's key and the keys of its network clients, in a folder with the files `server.key` and `clients`."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path

import zmq
from zmq.utils import z85

from fmfts.bus.client_list import (
    CLIENT_NAME,
    MAY_CHANGE,
    READ_ONLY,
    Client,
    ClientList,
    KeysError,
    unreadable,
)
from fmfts.bus.lock import BusError
from fmfts.common.writing import why_not_written
from fmfts.service.state import give_to
from fmfts_client.keys import BadKeyError, read_fields

PRIVATE = 0o600
NEW_SERVER_KEY = (
    "take it from a copy, or delete it and all clients' keys, and make new ones with `fmfts-daemon keys new NAME`"
)


class NotWrittenError(BusError):
    """A key or the list of keys cannot be written."""


class OptionError(BusError):
    """A client's name is invalid, taken, or not on the list."""


@dataclass(frozen=True)
class ServerKey:
    """The daemon's pair of CURVE keys, both in Z85."""

    public: bytes
    secret: bytes = field(repr=False)


class KeyFolder:
    """The folder that `[bus] keys` names. Raises KeysError, with what to do, where it cannot be used."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._server = folder / "server.key"
        self._list = ClientList(folder / "clients")

    def server(self) -> ServerKey:
        """The daemon's keys, read from `server.key`."""
        try:
            return ServerKey(*read_fields(self._server, ("public", "secret"), NEW_SERVER_KEY))
        except BadKeyError as error:
            if isinstance(error.__cause__, OSError):
                raise unreadable(f"key {self._server}", error.__cause__) from error
            raise KeysError(str(error)) from error

    def clients(self) -> dict[str, Client]:
        """The clients that may connect, by their names."""
        return self._list.read()

    def check(self) -> None:
        """Raise KeysError if the daemon could admit nobody."""
        self.server()
        self.clients()

    def client_with(self, public: bytes) -> Client | None:
        """The client with this public key (32 bytes); None: it may not connect."""
        return self._list.with_key(public)

    def add(self, name: str, output: Path, *, may_change: bool = False) -> None:
        """Make a key for a new client: write it to `output`, and its public half to the list.

        Makes the daemon's own key first where there is none.
        """
        if not CLIENT_NAME.fullmatch(name):
            raise OptionError(f"{name!r} is not a client's name: 1 to 64 letters, digits, dots, - or _")
        try:
            self.folder.mkdir(mode=0o750, parents=True, exist_ok=True)
            if not self._server.exists():
                public, secret = zmq.curve_keypair()
                text = f"{_line('public', public)}{_line('secret', secret)}"
                _create(self._server, text, self.folder.stat())
                self._list.create()
            known = self.clients()
            if name in known:
                raise OptionError(f"there is a client {name!r} already: `fmfts-daemon keys forget {name}` first")
            public, secret = zmq.curve_keypair()
            head = f"# The key of fmfts client {name}: whoever has it is let in. FMFTS_KEY names this file.\n"
            lines = _line("server", self.server().public) + _line("public", public) + _line("secret", secret)
            _create(output, head + lines)
            self._list.write(known | {name: Client(name, z85.decode(public), may_change)})
        except OSError as error:
            raise NotWrittenError(f"{error.filename}: {why_not_written(error)}") from error

    def grant(self, name: str, *, may_change: bool) -> None:
        """Change what a client may do; it counts from its next request on."""
        known = self.clients()
        self._write(known | {name: replace(self._named(name, known), may_change=may_change)})

    def forget(self, name: str) -> None:
        """Remove a client's key from the list.

        The daemon answers no request of it any more, and does not let it in again. A client that is connected receives
        contacts until the daemon restarts: libzmq has no call that ends one connection.
        """
        known = self.clients()
        self._write({other: client for other, client in known.items() if client != self._named(name, known)})

    def _named(self, name: str, known: dict[str, Client]) -> Client:
        if name not in known:
            raise OptionError(f"there is no client {name!r} in {self._list.path}: {', '.join(known) or 'nobody'}")
        return known[name]

    def _write(self, clients: dict[str, Client]) -> None:
        try:
            self._list.write(clients)
        except OSError as error:
            raise NotWrittenError(f"{error.filename or self._list.path}: {why_not_written(error)}") from error


def why_refused(keys: KeyFolder, verb: str, changes: bool, public: bytes) -> str:
    """Why the client with this key may not ask for `verb`; "" where it may. changes: the verb changes something."""
    try:
        client = keys.client_with(public)
    except KeysError as error:
        return f"{verb} is refused, because the daemon cannot read its list of keys: {error}"
    if client is None:
        return f"{verb} is refused: your key is not on the daemon's list any more (`fmfts-daemon keys list` there)"
    if changes and not client.may_change:
        return (
            f"{verb} is refused: the key of client {client.name!r} is {READ_ONLY}. To let it change things, run on the "
            f"daemon's machine: fmfts-daemon keys set {client.name} --{MAY_CHANGE}"
        )
    return ""


def _line(name: str, key: bytes) -> str:
    return f'{name} = "{key.decode()}"\n'


def _create(path: Path, text: str, owned_like: os.stat_result | None = None) -> None:
    """Writes a new file that only its owner can ever read; raises FileExistsError where the file exists.

    owned_like: status of what has the owner that root gives it.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, PRIVATE)
    with os.fdopen(descriptor, "w") as file:
        if owned_like is not None:
            give_to(owned_like, descriptor)
        file.write(text)
