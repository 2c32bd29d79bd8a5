"""The log on stderr: for the journal with its priorities, for people with the time."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Mapping
from typing import TextIO

# syslog(3); the journal reads the number in front of a line (sd-daemon(3))
PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (logging.DEBUG, 7))


class JournalFormatter(logging.Formatter):
    """`<4>text`: every line of a traceback needs the number again, for the journal splits at lines."""

    def format(self, record: logging.LogRecord) -> str:
        priority = next((number for level, number in PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines() or [""])


def configure(
    level: int = logging.INFO,
    stream: TextIO | None = None,
    environ: Mapping[str, str] = os.environ,
    *,
    command: str = "",
) -> None:
    """Send the log to `stream` (stderr). Replaces what an earlier call set up.

    command: which a person waits for; what it has to say bears its name, not the time.
    """
    stream = sys.stderr if stream is None else stream
    handler = logging.StreamHandler(stream)
    if is_journal(stream, environ):
        handler.setFormatter(JournalFormatter("%(message)s"))
    elif command:
        handler.setFormatter(logging.Formatter(f"{command}: %(message)s"))
    else:
        handler.setFormatter(logging.Formatter("%(asctime)s.%(msecs)03d %(levelname)s %(message)s", "%H:%M:%S"))
    logging.basicConfig(level=level, handlers=[handler], force=True)


def is_journal(stream: TextIO, environ: Mapping[str, str]) -> bool:
    """Does `stream` end in the journal? systemd gives device and inode of the stream that it connected.

    The variable alone proves nothing: every shell in a desktop session inherits one.
    """
    try:
        found = os.fstat(stream.fileno())
    except (OSError, ValueError):  # a stream without a descriptor
        return False
    return environ.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"
