"""Reads a client's key for the network (CURVE, RFC 26), one file for each client; `fmfts-daemon keys new` makes it."""

from __future__ import annotations

import ipaddress
import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Optional

import zmq

from fmfts_client.endpoints import EndpointError

KEY_VARIABLE = "FMFTS_KEY"
LARGEST_KEY_FILE = 4096
KEY_CHARACTERS = 40  # 32 bytes in Z85 (RFC 32)
# The owner may read and write it, a service's group may read it.
FORBIDDEN_MODE = 0o037

_LINE = re.compile(r'^(\w+) = "([^"]*)"$', re.MULTILINE)


class BadKeyError(EndpointError):
    """A key cannot be used; the text names the file and what to do."""


@dataclass(frozen=True)
class ClientKey:
    """server: public key of the expected daemon. public, secret: the client's own keys. All are Z85."""

    server: bytes
    public: bytes
    secret: bytes = field(repr=False)


def read_fields(path: Path, names: tuple[str, ...]) -> list[bytes]:
    """The keys of these names in a key file. Raises BadKeyError where others may read it, or a key is missing."""
    try:
        with path.open("rb") as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            content = file.read(LARGEST_KEY_FILE + 1)
    except OSError as error:
        raise BadKeyError(f"key {path} cannot be read: {error.strerror}") from error
    if mode & FORBIDDEN_MODE:
        raise BadKeyError(f"key {path} is open to others (mode {mode:04o}): chmod 600 {path}")
    keys = dict(_LINE.findall(content.decode(errors="replace"))) if len(content) <= LARGEST_KEY_FILE else {}
    missing = [name for name in names if len(keys.get(name, "")) != KEY_CHARACTERS]
    if missing:
        raise BadKeyError(f"key {path} has no {', '.join(missing)}: make another with `fmfts-daemon keys new`")
    return [keys[name].encode("ascii", errors="replace") for name in names]


def key_in_use(environ: Mapping[str, str] = os.environ) -> Optional[Path]:
    """The file that FMFTS_KEY names; None where it names none."""
    return Path(environ[KEY_VARIABLE]) if environ.get(KEY_VARIABLE) else None


def client_key(path: Optional[Path] = None, environ: Mapping[str, str] = os.environ) -> Optional[ClientKey]:
    """The key in `path`, or else in the file that FMFTS_KEY names; None where neither is given."""
    chosen = path or key_in_use(environ)
    return None if chosen is None else ClientKey(*read_fields(chosen, ("server", "public", "secret")))


def show_key(socket: zmq.Socket[Any], endpoint: str, path: Optional[Path] = None) -> None:
    """Set the client's key on a socket, before it connects to `endpoint`. Raises BadKeyError where it needs one.

    path: the key's file; None: the one that FMFTS_KEY names, if any. ipc needs no key: there the permissions of the
    socket decide who may connect.
    """
    if not endpoint.startswith("tcp://"):
        return
    key = client_key(path)
    if key is not None:
        socket.curve_serverkey, socket.curve_publickey, socket.curve_secretkey = key.server, key.public, key.secret
    elif not is_loopback(endpoint):
        raise BadKeyError(
            f"{endpoint} is on the network, where fmfts-daemon accepts only clients with a key that it knows: "
            f"make one with `fmfts-daemon keys new NAME` on its machine, and set {KEY_VARIABLE} to that file here"
        )


def is_loopback(endpoint: str) -> bool:
    """Is a tcp endpoint on this machine alone? A name other than localhost may be any machine."""
    host = endpoint[len("tcp://") :].rpartition(":")[0].strip("[]")
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
