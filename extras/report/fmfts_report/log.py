"""The end of the service's log, as systemd's journal has it."""

from __future__ import annotations

import shutil
import subprocess

PATIENCE_S = 10.0
LINES = 2000


class NoLogError(Exception):
    """The journal cannot be read, or has nothing of the service."""


def journal(most_bytes: int) -> str:
    """The last lines of the service's log, at most `most_bytes` of them. Raises NoLogError."""
    program = shutil.which("journalctl")
    if program is None:
        raise NoLogError("this computer has no journalctl")
    command = [program, "--unit", "fmfts", "--lines", str(LINES), "--no-pager", "--no-hostname", "--quiet"]
    try:
        ended = subprocess.run(
            [*command, "--output", "short-iso"], capture_output=True, timeout=PATIENCE_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoLogError(f"journalctl gives none: {error}") from error
    if ended.returncode != 0 or not ended.stdout.strip():
        why = ended.stderr.decode(errors="replace").strip().partition("\n")[0] or "the journal has no line of it"
        raise NoLogError(f"{why}; if there is a service, join the group systemd-journal, or use sudo")
    return ended.stdout[-most_bytes:].decode(errors="replace")
