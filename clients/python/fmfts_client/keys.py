"""Reads a client's key for the network (CURVE, RFC 26), one file for each client; `fmfts-daemon keys new` makes it."""

from __future__ import annotations

import ipaddress
import os
import re
import stat
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Optional

import zmq
from zmq.utils import z85

from fmfts_client.endpoints import EndpointError

KEY_VARIABLE = "FMFTS_KEY"
LARGEST_KEY_FILE = 4096
KEY_CHARACTERS = 40  # 32 bytes in Z85 (RFC 32)
# The owner may read and write it, a service's group may read it.
FORBIDDEN_MODE = 0o037
# Without O_NONBLOCK a pipe in the file's place would make the reader wait for ever. Windows lacks two of these flags.
READ_ONLY = os.O_RDONLY | sum(getattr(os, flag, 0) for flag in ("O_NONBLOCK", "O_CLOEXEC", "O_BINARY"))

ANOTHER_KEY = "make another with `fmfts-daemon keys new NAME` on the daemon's machine"

_LINE = re.compile(r'(\w+) = "([^"]*)"')


class BadKeyError(EndpointError):
    """A key cannot be used; the text names the file and what to do."""


@dataclass(frozen=True)
class ClientKey:
    """server: public key of the expected daemon. public, secret: the client's own keys. All are Z85."""

    server: bytes
    public: bytes
    secret: bytes = field(repr=False)


def decoded(key: str) -> Optional[bytes]:
    """The 32 bytes of a key in Z85; None where the text is no key."""
    try:
        return z85.decode(key) if len(key) == KEY_CHARACTERS else None
    except (KeyError, ValueError, struct.error):  # struct.error: five characters beyond 32 bits
        return None


def read_fields(path: Path, names: tuple[str, ...], remedy: str = ANOTHER_KEY) -> list[bytes]:
    """The keys of these names in a key file, `public` and `secret` among them. remedy: what to do with a damaged file.

    Raises BadKeyError where others may read it, where a key is missing or damaged, or where the two are no pair.
    """
    text = _private_text(path)
    keys = {line[1]: line[2] for line in map(_LINE.fullmatch, text.splitlines()) if line}
    missing = [name for name in names if decoded(keys.get(name, "")) is None]
    if missing:
        raise BadKeyError(f"key {path} has no usable {', '.join(missing)}: {remedy}")
    try:
        fitting = zmq.curve_public(keys["secret"].encode())
    except zmq.ZMQError as error:
        raise BadKeyError(f"key {path} cannot be used: this libzmq was built without CURVE") from error
    if fitting != keys["public"].encode():
        raise BadKeyError(f"key {path} is damaged: its public and its secret key are no pair: {remedy}")
    return [keys[name].encode() for name in names]


def _private_text(path: Path) -> str:
    """The content of a key file; what is larger than one, is no file, or may be read by others is refused."""
    try:
        descriptor = os.open(path, READ_ONLY)
        try:
            mode = os.fstat(descriptor).st_mode
            content = os.read(descriptor, LARGEST_KEY_FILE + 1) if stat.S_ISREG(mode) else b""
        finally:
            os.close(descriptor)
    except (OSError, ValueError) as error:  # ValueError: a name with a null byte
        raise BadKeyError(f"key {path} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not stat.S_ISREG(mode):
        raise BadKeyError(f"key {path} is not a file, but a folder, a pipe or a device: name the key's file")
    if hasattr(os, "getuid") and mode & FORBIDDEN_MODE:  # Windows has no such modes
        raise BadKeyError(f"key {path} is open to others (mode {stat.S_IMODE(mode):04o}): chmod 600 {path}")
    if len(content) > LARGEST_KEY_FILE:
        raise BadKeyError(
            f"key {path} is larger than {LARGEST_KEY_FILE} bytes, so it is not a key: name the key's file"
        )
    return content.decode(errors="replace")


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
