"""Locks a device for one user: by an flock on the device node itself, so that no lock file can be left behind."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

from fmfts.sensor.source import SourceError


def lock_device(descriptor: int, path: str) -> None:
    """Lock the device for as long as `descriptor` is open; SourceError names the process that holds it."""
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


def not_permitted(error: OSError, group: str) -> str:
    """The end of a sentence about a device without permission; group: its usual group.

    The modes of the node give EACCES; EPERM comes of a service's DeviceAllow=, resolved once at its start (systemd
    leaves out classes whose driver is not loaded by then: systemd.resource-control(5)).
    """
    if error.errno == errno.EPERM:
        return (
            "is not among the devices that the service was given at its start, when the driver was not loaded yet, or "
            "DeviceAllow= does not name it: `systemctl restart fmfts`; if that does not help, `systemctl edit fmfts`"
        )
    return (
        f"is there, but you may not open it: `sudo usermod -aG {group} $USER` (the device's group on Debian), "
        "then log in again"
    )


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
