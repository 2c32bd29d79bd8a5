"""Runs `fmfts-daemon view` beside a demo: a process of its own, which ends with the demo."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fmfts.cli import elsewhere
from fmfts.cli.verb import not_installed
from fmfts.common.extras import entry_points_of
from fmfts.service.child import end_with_this_process

STOP_S = 5.0
USUAL_PORT: tuple[str, ...] = ()  # an open tab finds the next demo there
ANY_PORT = "--port", "0"


@contextmanager
def page_beside(folder: Path, base: str, *options: str) -> Iterator[Callable[[], str]]:
    """Start the page for the daemon at `base`; its log goes to `folder`. options: further ones of `view`.

    Yields a function that waits until the page is served, and returns a line with its address, or with what is wrong.
    """
    if all(point.name != "view" for point in entry_points_of(elsewhere.VERBS)):
        absent = f"no page: {not_installed('view', elsewhere.OF_VERB['view'][1])}"
        yield lambda: absent
        return
    log = folder / "view.log"
    view = _started(base, log, *USUAL_PORT, *options)

    def line() -> str:
        nonlocal view
        said = _said_by(view)
        if not said:  # another demo has taken the port
            _stop(view)
            view = _started(base, log, *ANY_PORT, *options)
            said = _said_by(view)
        return said or f"no page: {log.read_text().strip()}"

    try:
        yield line
    finally:
        _stop(view)


def _started(base: str, log: Path, *options: str) -> subprocess.Popen[str]:
    from fmfts_client.endpoints import OVERRIDE

    with log.open("w") as stderr:
        return subprocess.Popen(
            [sys.executable, "-m", "fmfts", "view", *options],
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            env=os.environ | {OVERRIDE: base},
            preexec_fn=end_with_this_process(_ignore_ctrl_c),
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


def _ignore_ctrl_c() -> None:
    """The terminal sends Ctrl-C to all processes; the demo ends this one by SIGTERM."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
