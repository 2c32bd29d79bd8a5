"""Runs `fmfts-daemon view` beside a demo: a process of its own, which ends with the demo."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fmfts.cli.view import PORT

STOP_S = 5.0


@contextmanager
def page_beside(folder: Path, base: str, *options: str) -> Iterator[Callable[[], str]]:
    """Start the page for the daemon at `base`; its log goes to `folder`. options: further ones of `view`.

    Yields a function that waits until the page is served, and returns a line with its address, or with what is wrong.
    """
    log = folder / "view.log"
    view = _started(_free_port(), base, log, options)

    def line() -> str:
        nonlocal view
        said = _said_by(view)
        if not said:  # another demo may have taken the port since
            _stop(view)
            view = _started(0, base, log, options)
            said = _said_by(view)
        return said or f"no page: {log.read_text().strip()}"

    try:
        yield line
    finally:
        _stop(view)


def _started(port: int, base: str, log: Path, options: tuple[str, ...]) -> subprocess.Popen[str]:
    from fmfts_client.endpoints import OVERRIDE

    with log.open("w") as stderr:
        return subprocess.Popen(
            [sys.executable, "-m", "fmfts", "view", "--port", str(port), *options],
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            env=os.environ | {OVERRIDE: base},
            preexec_fn=_ignore_ctrl_c,
        )


def _said_by(view: subprocess.Popen[str]) -> str:
    assert view.stdout is not None
    return view.stdout.readline().strip()


def _stop(view: subprocess.Popen[str]) -> None:
    view.terminate()
    try:
        view.wait(STOP_S)
    except subprocess.TimeoutExpired:
        view.kill()
        view.wait()
    if view.stdout is not None:
        view.stdout.close()


def _free_port() -> int:
    """The usual port, so that an open tab finds the next demo; another one if it is taken."""
    with socket.socket() as attempt:
        attempt.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            attempt.bind(("127.0.0.1", PORT))
        except OSError:
            return 0
    return PORT


def _ignore_ctrl_c() -> None:
    """The terminal sends Ctrl-C to all processes; the demo ends this one by SIGTERM."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
