"""The daemon's log, when nobody reads it."""

from __future__ import annotations

import fcntl
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from end_to_end.processes import PATIENCE_S, START_PATIENCE_S
from fmfts_client import Client

SIMULATED = """
[[pad]]
name = "left"
[pad.source]
type = "simulated"
"""
MANY_LINES = """
import logging
from fmfts.service import log
log.configure()
log.FLUSH_S = 20.0  # each line waits for the reader, which a busy computer holds up
for number in range(5000):
    logging.info("line %d", number)
print("done", flush=True)
"""
INTERRUPTED = """
import logging, signal
from fmfts.service import log
log.configure()
waiting = False

def add(number, frame):
    global waiting
    logging.info("amid another")
    waiting = False

signal.signal(signal.SIGALRM, add)
for number in range(20000):
    if not waiting:  # on a slow computer signals that came by themselves would be amid each other to any depth
        waiting = True
        signal.setitimer(signal.ITIMER_REAL, 1e-4)
    logging.info("line %d", number)
signal.setitimer(signal.ITIMER_REAL, 0)
"""
F_SETPIPE_SZ = 1031  # fcntl(2)
FILLING = b"." * 4096


@contextmanager
def full_pipe() -> Iterator[tuple[int, int]]:
    """The read end and the write end of a full pipe, like a journal that hangs."""
    reading, writing = os.pipe()
    fcntl.fcntl(writing, F_SETPIPE_SZ, len(FILLING))
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, FILLING)
    os.set_blocking(writing, True)
    yield reading, writing
    os.close(reading)
    with suppress(OSError):
        os.close(writing)


def everything(reading: int) -> str:
    heard = b""
    while data := os.read(reading, 65536):
        heard += data
    return heard.replace(FILLING, b"").decode()


def test_contacts_continue_when_the_log_is_not_read(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text(SIMULATED)
    environment = os.environ | {"FMFTS_BUS": f"ipc://{tmp_path}", "XDG_STATE_HOME": str(tmp_path)}
    with full_pipe() as (_, writing):
        command = [sys.executable, "-m", "fmfts", "run", "--config", str(config)]
        daemon = subprocess.Popen(command, stderr=writing, env=environment)
        os.close(writing)
        try:
            with Client("left", f"ipc://{tmp_path}") as pad:
                assert pad.latest(timeout_s=START_PATIENCE_S) is not None
            daemon.send_signal(signal.SIGTERM)
            assert daemon.wait(PATIENCE_S) == 0
        finally:
            daemon.kill()
            daemon.wait(PATIENCE_S)


def test_delayed_lines_are_written_and_dropped_ones_counted() -> None:
    with full_pipe() as (reading, writing):
        program = subprocess.Popen([sys.executable, "-c", MANY_LINES], stderr=writing, stdout=subprocess.PIPE)
        os.close(writing)
        assert program.stdout is not None
        limit = threading.Timer(PATIENCE_S, program.kill)  # the reads below then end
        limit.start()
        assert program.stdout.readline() == b"done\n", "a full log delays the program"
        heard = everything(reading)
        program.communicate()
        limit.cancel()
    written = len(re.findall(r"line \d+$", heard, re.MULTILINE))
    left_out = [int(count) for count in re.findall(r"(\d+) lines were left out", heard)]  # reported once or twice
    assert written + sum(left_out) == 5000
    assert 1000 <= written < 5000


def test_log_line_from_signal_handler_does_not_deadlock() -> None:
    """Like a daemon that is stopped while it logs."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0
    assert "amid another" in done.stderr
    assert "Traceback" not in done.stderr
