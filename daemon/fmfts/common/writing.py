"""Says why a file could not be written, and what to do about it."""

from __future__ import annotations

import errno

FULL = {
    errno.ENOSPC: "the disk is full: make room on it (`df -h` shows how much there is), then do it again",
    errno.EDQUOT: "your share of the disk is used up: delete what you no longer need, then do it again",
    errno.EFBIG: "files may not grow larger here (`ulimit -f`): allow larger ones, then do it again",
}


def why_not_written(error: OSError, elsewhere: str = "name another place") -> str:
    """The system's words and what to do. elsewhere: how to name another place, if this one cannot be used."""
    return f"{error.strerror or error}: {FULL.get(error.errno or 0) or _other(error, elsewhere)}"


def _other(error: OSError, elsewhere: str) -> str:
    match error.errno:
        case errno.EROFS:
            return f"this file system can only be read: {elsewhere}"
        case errno.EACCES | errno.EPERM:
            return f"make it writable for this user, or {elsewhere}"
        case errno.ENOENT | errno.ENOTDIR:
            return f"make its folder first, or {elsewhere}"
        case errno.EEXIST:
            return elsewhere
        case _:
            return f"look at that disk, or {elsewhere}"
