"""Finds the endpoints where daemon and clients meet; both use this module.

In order: `FMFTS_BUS` (a base, see `Endpoints.from_base`); the service's `/run/fmfts`; `$XDG_RUNTIME_DIR/fmfts`;
`fmfts-<uid>` in the directory for temporary files. Whoever can place a socket there can send a robot any force. So
the last two belong to the user: they are made with mode 0700, and refused when another user owns or may enter them.
Root alone can make `/run/fmfts`. A named folder is refused where any user could have made it, and another user has.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Optional, Union

OVERRIDE = "FMFTS_BUS"
SERVICE_USER = "fmfts"
SERVICE_DIRECTORY = Path("/run/fmfts")
LONGEST_SOCKET_PATH = 107  # sockaddr_un.sun_path holds 108 bytes with the closing zero


class EndpointError(Exception):
    """An endpoint is malformed or not safe; the text says which one, and what to do."""


@dataclass(frozen=True)
class Endpoints:
    """ZeroMQ endpoints: `bus` (contacts, events, status), `control` (requests), `frames` (raw counts).

    key: the file of the client's key for this daemon, for clients of several daemons; None: the one that FMFTS_KEY
    names.
    """

    bus: str
    control: str
    frames: str
    key: Optional[Path] = None

    @property
    def joints(self) -> str:
        """Where the daemon receives joint positions: `…/joints` beside the bus; over tcp the bus's port + 3."""
        if self.bus.startswith("ipc://"):
            return f"{self.bus.rpartition('/')[0]}/joints"
        host, _, port = self.bus.rpartition(":")
        return f"{host}:{int(port) + 3}"

    @classmethod
    def from_base(cls, base: str, key: Optional[Path] = None) -> Endpoints:
        """The three endpoints of a base.

        `ipc:///path/dir` → `ipc:///path/dir/bus`, `…/control`, `…/frames`;
        `tcp://host:port` → bus on `port`, control on `port + 1`, frames on `port + 2`, joints on `port + 3`. A
        socket of the directory (`ipc:///path/dir/bus`, as `listen` prints it) means the directory.
        """
        if base.startswith("ipc:///"):
            return cls._in_directory(_directory_of(base), key)
        host, colon, port = base[len("tcp://") :].rpartition(":")
        if base.startswith("tcp://") and colon and host and port.isdecimal() and 0 < int(port) <= 65532:
            bus, control, frames = (f"tcp://{host}:{int(port) + offset}" for offset in range(3))
            return cls(bus, control, frames, key)
        raise EndpointError(
            f"{base!r} is not a base of endpoints: give ipc:///absolute/directory or tcp://host:port (port at most "
            "65532)"
        )

    @classmethod
    def _in_directory(cls, directory: Path, key: Optional[Path] = None) -> Endpoints:
        if len(os.fsencode(directory / "control")) > LONGEST_SOCKET_PATH:
            raise EndpointError(
                f"{directory} is too long for a socket (at most {LONGEST_SOCKET_PATH} bytes with the name): "
                f"choose a shorter directory with {OVERRIDE}"
            )
        bus, control, frames = (f"ipc://{directory / name}" for name in ("bus", "control", "frames"))
        return cls(bus, control, frames, key)


def _directory_of(base: str) -> Path:
    """The directory of a base that begins with ipc://."""
    path = Path(base[len("ipc://") :])
    try:
        return path.parent if path.is_socket() else path
    except OSError as error:
        raise EndpointError(
            f"cannot see whether a daemon serves {base}: {error.strerror}: run this as the daemon's user or a member "
            f"of its group, or name another place with {OVERRIDE}"
        ) from error


def named_base(configured: Optional[str] = None, environ: Mapping[str, str] = os.environ) -> Optional[str]:
    """The base that FMFTS_BUS names, else the one in the daemon's configuration; None: the default."""
    return environ.get(OVERRIDE) or configured


def for_client(endpoint: Optional[Union[str, Endpoints]] = None, environ: Mapping[str, str] = os.environ) -> Endpoints:
    """The endpoints for a client: those given (a base or Endpoints), else FMFTS_BUS, else the defaults."""
    if isinstance(endpoint, Endpoints):
        return endpoint
    base = endpoint or named_base(environ=environ)
    if base:
        return _guarded(base, must_be_there=True)
    if SERVICE_DIRECTORY.is_dir():
        if not os.access(SERVICE_DIRECTORY, os.X_OK):
            raise EndpointError(
                f"the service's {SERVICE_DIRECTORY} is closed to you: join its group "
                f"(sudo usermod -aG fmfts $USER, then log in again), or name another daemon with {OVERRIDE}"
            )
        return Endpoints._in_directory(SERVICE_DIRECTORY)
    return Endpoints._in_directory(_own_directory(environ))


def for_daemon(configured: Optional[str] = None, environ: Mapping[str, str] = os.environ) -> Endpoints:
    """The endpoints for the daemon: FMFTS_BUS, else the base in its configuration, else the defaults.

    systemd sets RUNTIME_DIRECTORY for the daemon. Clients do not read it: theirs would belong to their own service.
    """
    base = named_base(configured, environ)
    if base:
        return _guarded(base, must_be_there=False)  # the daemon makes the folder, and then checks its owner
    service = environ.get("RUNTIME_DIRECTORY", "").split(":")[0]
    return Endpoints._in_directory(Path(service) if service else _own_directory(environ))


def _guarded(base: str, must_be_there: bool) -> Endpoints:
    """The endpoints of a named base. EndpointError if any user may put a socket there (also with the sticky bit).

    The user may mean a folder of another user or of a group, and trust them. But in a place like /tmp the name does not
    say whose the folder is. must_be_there: also refuse a folder there that does not exist: anybody could make it.
    """
    endpoints = Endpoints.from_base(base)
    if base.startswith("ipc://"):
        directory = _directory_of(base)
        for path in (directory.absolute(), directory.resolve()):
            nearest, mode = _nearest(path)
            if mode & stat.S_IWOTH and nearest == path:
                # A place like /tmp is meant for every user: closing it would stop other programs.
                close = "" if mode & stat.S_ISVTX else f", or close this one (chmod o-w {directory})"
                raise EndpointError(
                    f"{directory} may be written to by every user ({stat.filemode(mode)}): any of them could send "
                    f"false forces through a socket there. Name a folder inside it that is yours alone "
                    f"(mkdir -m 700 {directory}/fmfts; {OVERRIDE}=ipc://{directory}/fmfts){close}"
                )
            if mode & stat.S_IWOTH and must_be_there:
                raise EndpointError(
                    f"{directory} is not there, and any user may make it in {nearest}: its owner could send false "
                    f"forces through a socket there. So start the daemon first, or name another folder with "
                    f"{OVERRIDE}, for example one in your home"
                )
            _require_no_stranger(nearest)
    return endpoints


def _nearest(path: Path) -> tuple[Path, int]:
    """The folder, or where it is absent or closed to this user the nearest one above it; and its mode."""
    for folder in (path, *path.parents):
        with suppress(OSError):
            return folder, folder.stat().st_mode
    return path, 0


def _require_no_stranger(directory: Path) -> None:
    """Raise EndpointError if another user made the folder, or one above it, in a place where any user may make folders.

    directory: absolute.
    """
    for path in (directory, *directory.parents):
        place, owner = path.parent.stat(), path.lstat().st_uid
        if place.st_mode & stat.S_IWOTH and owner not in trusted_owners():
            raise EndpointError(
                f"{path} belongs to {name_of(owner)}, and any user may make such a folder in {path.parent}: its owner "
                f"could send false forces through a socket there. Name a folder that is yours, root's or the service's "
                f"with {OVERRIDE}, for example one in your home"
            )


def trusted_owners() -> set[int]:
    """Users whose sockets are trusted in any folder: this one, root, and the service's."""
    import pwd  # Windows has no such call, and its sockets have no owners

    owners = {os.getuid(), 0}
    with suppress(KeyError):  # no service is installed here
        owners.add(pwd.getpwnam(SERVICE_USER).pw_uid)
    return owners


def name_of(owner: int) -> str:
    import pwd

    try:
        return f"user {pwd.getpwuid(owner).pw_name}"
    except KeyError:
        return f"user {owner}"


def _own_directory(environ: Mapping[str, str]) -> Path:
    if not hasattr(os, "getuid"):
        raise EndpointError(f"on Windows name the daemon's machine: {OVERRIDE}=tcp://192.168.1.21:5570, for example")
    runtime = environ.get("XDG_RUNTIME_DIR", "")
    if runtime and Path(runtime).is_dir():
        directory = Path(runtime).absolute() / "fmfts"
    else:
        directory = Path(tempfile.gettempdir()) / f"fmfts-{os.getuid()}"
    try:
        directory.mkdir(mode=0o700, exist_ok=True)
        status = directory.lstat()
    except OSError as error:
        raise EndpointError(f"cannot use {directory} for the bus ({error.strerror}): set {OVERRIDE}") from error
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise EndpointError(
            f"{directory} is not a directory of yours alone (owner {status.st_uid}, "
            f"mode {stat.filemode(status.st_mode)}): another user could send false forces "
            f"through it. Remove it, or set {OVERRIDE}"
        )
    return directory
