"""Finds the directory of the daemon's state, and writes files there so that a power cut does not damage them."""

from __future__ import annotations

import os
import secrets
import stat
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

UNFINISHED_S = 60.0


def state_directory(environ: Mapping[str, str] = os.environ) -> Path:
    """$STATE_DIRECTORY (set by systemd), else $XDG_STATE_HOME/fmfts, else ~/.local/state/fmfts; made when missing.

    Raises OSError where it cannot be made.
    """
    service = environ.get("STATE_DIRECTORY", "").split(":")[0]
    home = environ.get("XDG_STATE_HOME", "")
    if service:
        directory = Path(service)
    elif Path(home).is_absolute():  # the XDG specification: a relative path is to be ignored
        directory = Path(home) / "fmfts"
    else:
        directory = Path.home() / ".local" / "state" / "fmfts"
    directory.mkdir(parents=True, exist_ok=True)
    return directory


def write_atomically(path: Path, content: bytes) -> None:
    """Replace the content of `path`. A power cut leaves either all of `content` there or all of the old content.

    The file keeps its owner, group and mode as far as this user may set them, so that the service can still read what
    root has changed; root's new file gets the folder's owner and group.

    On an error it raises OSError and leaves no temporary file.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        with open(descriptor, "wb") as file:
            _take_after(path, descriptor)
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    _sync_directory(path.parent)
    _remove_unfinished(path)


def give_to(like: os.stat_result, descriptor: int) -> None:
    """Give an open file the owner and group in `like`: root may do so; a user may give it one of its own groups."""
    for owner in (like.st_uid, -1):
        with suppress(OSError):  # then its owner is its writer
            os.fchown(descriptor, owner, like.st_gid)
            return


def _take_after(path: Path, descriptor: int) -> None:
    """Gives an open file what `path` has, which it replaces. A link gives nothing: its owner may not own its target."""
    try:
        old = path.lstat()
    except FileNotFoundError:
        if os.geteuid() == 0:
            give_to(path.parent.stat(), descriptor)
        return
    if stat.S_ISREG(old.st_mode):
        os.fchmod(descriptor, old.st_mode & 0o777)
        give_to(old, descriptor)


def _remove_unfinished(path: Path) -> None:
    """Removes temporary files of killed writers. A file younger than UNFINISHED_S may belong to a running writer."""
    for temporary in path.parent.glob(f".{path.name}.*.tmp"):
        with suppress(FileNotFoundError):
            if time.time() - temporary.stat().st_mtime > UNFINISHED_S:
                temporary.unlink()


def _sync_directory(directory: Path) -> None:
    """Writes the directory to the disk, without which a power cut may lose the new name."""
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
