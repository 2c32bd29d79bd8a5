"""Runs a daemon as a child process for a moment: for the demo, and for a report where no daemon runs."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

START_S = 60.0  # on an overloaded computer it has not begun to serve after twenty
STOP_S = 5.0
PR_SET_PDEATHSIG = 1  # of prctl(2)
ENDING = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}


class ChildDaemon:
    """ended: the exit code of a daemon that ended by itself; None: it runs, or was stopped."""

    def __init__(self, process: subprocess.Popen[bytes], socket: Path) -> None:
        self.process = process
        self.ended: int | None = None
        self._socket = socket

    def is_serving(self) -> bool:
        """Wait until it serves. False if it ends before, or takes longer than START_S."""
        until = time.monotonic() + START_S
        while not self._socket.exists():
            if self.process.poll() is not None or time.monotonic() > until:
                return False
            time.sleep(0.02)
        return True

    def stop(self) -> None:
        self.ended = self.process.poll()
        self.process.terminate()
        try:
            self.process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


@contextmanager
def child_daemon(
    config: Path, folder: Path, environment: Mapping[str, str], sockets: Path | None = None
) -> Iterator[ChildDaemon]:
    """Runs `fmfts-daemon run` until the end of the block. Its log goes to `daemon.log` in `folder`.

    environment: names `sockets`, by default `folder`, as the place of its sockets.
    """
    command = [sys.executable, "-m", "fmfts", "run", "--config", str(config)]
    with (folder / "daemon.log").open("w") as stderr:
        # Block signals: one between fork and `try` would leave the daemon running.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        child = None
        try:
            try:
                process = subprocess.Popen(
                    command, stderr=stderr, env=environment, preexec_fn=end_with_this_process(_ignore_ctrl_c)
                )
                child = ChildDaemon(process, (sockets or folder) / "bus")
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            yield child
        finally:
            if child is not None:
                child.stop()


def end_with_this_process(also: Callable[[], None]) -> Callable[[], None]:
    """For `preexec_fn`: the child gets SIGTERM when the thread that starts it ends, even by SIGKILL."""
    libc, parent = ctypes.CDLL(None), os.getpid()

    def prepare() -> None:
        also()
        end_with(parent, signal.SIGTERM, libc)

    return prepare


def end_with(parent: int, by: signal.Signals, libc: ctypes.CDLL) -> None:
    """Lets this process get the signal when the thread that forked it in `parent` ends; see prctl(2)."""
    libc.prctl(PR_SET_PDEATHSIG, by)
    if os.getppid() != parent:
        os.kill(os.getpid(), by)


def _ignore_ctrl_c() -> None:
    """Makes the daemon ignore Ctrl-C, which the terminal sends to all processes: it will be ended by SIGTERM."""
    signal.pthread_sigmask(signal.SIG_SETMASK, {signal.SIGINT})
