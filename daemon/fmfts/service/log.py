"""Configures the log on stderr: lines with priorities for systemd's journal, or with the time for people."""

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

# Priorities of syslog(3), which the journal reads in front of a line (sd-daemon(3))
PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (logging.DEBUG, 7))


class JournalFormatter(logging.Formatter):
    """Writes `<4>text`. Each line of a traceback gets the number, because the journal treats lines as records."""

    def format(self, record: logging.LogRecord) -> str:
        priority = next((number for level, number in PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines() or [""])


LONGEST_QUEUE = 1000  # lines
FLUSH_S = 1.0  # longest wait at exit for the last lines


class PatientHandler(logging.Handler):
    """Writes lines in its own thread, so that a disk or journal that stalls for seconds does not delay contacts.

    Drops and counts the lines that would wait behind LONGEST_QUEUE others.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self._descriptor = descriptor
        # A signal handler may log while its thread is inside put(): SimpleQueue allows that, queue.Queue deadlocks.
        self._lines: queue.SimpleQueue[str | threading.Event] = queue.SimpleQueue()
        self._left_out = 0
        threading.Thread(target=self._write, name="log", daemon=True).start()

    def emit(self, record: logging.LogRecord) -> None:
        if self._lines.qsize() >= LONGEST_QUEUE:
            self._left_out += 1
            return
        self._report_left_out()
        self._lines.put(self.format(record))

    def flush(self) -> None:
        """Waits until all lines are written, FLUSH_S at most. Also called at exit."""
        self._report_left_out()
        written = threading.Event()
        self._lines.put(written)
        written.wait(FLUSH_S)

    def _report_left_out(self) -> None:
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
            with suppress(OSError):  # the log cannot be written, which cannot be reported elsewhere
                while data:
                    # Another program that shares the terminal may have made it non-blocking.
                    select.select([], [self._descriptor], [])
                    data = data[os.write(self._descriptor, data) :]


def configure(
    level: int = logging.INFO,
    stream: TextIO | None = None,
    environ: Mapping[str, str] = os.environ,
    *,
    command: str = "",
) -> None:
    """Send the log to `stream` (default: stderr). Replaces the configuration of an earlier call.

    command: name of a command for which a person waits; its lines begin with that name, not with the time. "": the
    service.
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
    """Does `stream` go to the journal? $JOURNAL_STREAM holds device and inode of the stream that systemd connected.

    That the variable is set proves nothing: every shell in a desktop session inherits it.
    """
    try:
        status = os.fstat(stream.fileno())
    except (OSError, ValueError):  # a stream without a descriptor
        return False
    return environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"
