"""One user per device: an flock on the device node itself, so that no lock file can be left behind."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from fmfts.sensor.source import SourceError


def lock_device(descriptor: int, path: str) -> None:
    """Take the device for as long as `descriptor` is open; SourceError names who has it."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise SourceError(in_use(path)) from None


def in_use(path: str) -> str:
    """The sentence for a device that another process has locked."""
    pid = _holder(path)
    if pid is None:
        return f"{path} is in use by another process: stop it first (`fuser {path}` may name it)"
    return f"{path} is in use by process {pid} ({_command(pid)}): stop that one first"


def _holder(path: str) -> int | None:
    """Process with an flock on `path`, by /proc/locks: `1: FLOCK ADVISORY WRITE pid major:minor:inode 0 EOF`."""
    try:
        node = os.stat(path)
        locks = Path("/proc/locks").read_text().splitlines()
    except OSError:
        return None
    device = f"{os.major(node.st_dev):02x}:{os.minor(node.st_dev):02x}:{node.st_ino}"
    for line in locks:
        words = line.split()
        if "FLOCK" in words and "->" not in words and device in words and words[4].isdigit():
            return int(words[4])
    return None


def _command(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ").strip()[:80] or "unnamed"
    except OSError:
        return "command unknown"
