"""The log on stderr: for the journal with its priorities, for people with the time."""

from __future__ import annotations

import logging
import os
import queue
import select
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from typing import TextIO

# syslog(3); the journal reads the number in front of a line (sd-daemon(3))
PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (logging.DEBUG, 7))


class JournalFormatter(logging.Formatter):
    """`<4>text`: every line of a traceback needs the number again, for the journal splits at lines."""

    def format(self, record: logging.LogRecord) -> str:
        priority = next((number for level, number in PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines() or [""])


LINES_WAITING = 1000
# A service's stop may take longer; a person's patience not much.
LAST_LINES_S = 1.0


class PatientHandler(logging.Handler):
    """Lines are written by a thread of their own: a disk or a journal that stalls for seconds holds up no contact.

    What would wait behind LINES_WAITING others is left out and counted.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor
        # A signal's handler logs too, and may do so amid another line's put: this queue takes that, queue.Queue hangs.
        self._lines: queue.SimpleQueue[str | threading.Event] = queue.SimpleQueue()
        self._left_out = 0
        threading.Thread(target=self._write, name="log", daemon=True).start()

    def emit(self, record: logging.LogRecord) -> None:
        if self._lines.qsize() >= LINES_WAITING:
            self._left_out += 1
            return
        self._tell_left_out()
        self._lines.put(self.format(record))

    def flush(self) -> None:
        """Called at exit, too: until all is written, or nobody takes it for a second."""
        self._tell_left_out()
        written = threading.Event()
        self._lines.put(written)
        written.wait(LAST_LINES_S)

    def _tell_left_out(self) -> None:
        left_out, self._left_out = self._left_out, 0
        if left_out:
            text = f"{left_out} lines were left out here: the log was not taken in time"
            record = logging.makeLogRecord({"levelno": logging.WARNING, "levelname": "WARNING", "msg": text})
            self._lines.put(self.format(record))

    def _write(self) -> None:
        while True:
            line = self._lines.get()
            if isinstance(line, threading.Event):
                line.set()
                continue
            data = memoryview(f"{line}\n".encode(errors="backslashreplace"))
            with suppress(OSError):  # there is nobody to be told that the log cannot be written
                while data:
                    select.select([], [self._descriptor], [])  # who shares a terminal may have made it non-blocking
                    data = data[os.write(self._descriptor, data) :]


def configure(
    level: int = logging.INFO,
    stream: TextIO | None = None,
    environ: Mapping[str, str] = os.environ,
    *,
    command: str = "",
) -> None:
    """Send the log to `stream` (stderr). Replaces what an earlier call set up.

    command: which a person waits for; what it has to say bears its name, not the time. "": a service.
    """
    stream = sys.stderr if stream is None else stream
    handler = logging.StreamHandler(stream) if command else PatientHandler(stream.fileno())
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
