"""What a test that ended its process left running is ended: a worker that faulthandler ends cannot do it itself.

A pytest plugin for pytest-xdist, whose workers tell their children by the environment who started them.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest


@pytest.hookimpl(optionalhook=True)  # without pytest-xdist there are no workers
def pytest_testnodedown(node: Any, error: object | None) -> None:
    if error:
        for process in started_by(node.gateway.id, node.workerinput["testrunuid"]):
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)


def started_by(worker: str, run: str) -> Iterator[int]:
    """All processes whose environment names this worker of this run, whatever their session and parent."""
    told = {f"PYTEST_XDIST_WORKER={worker}".encode(), f"PYTEST_XDIST_TESTRUNUID={run}".encode()}
    for process in Path("/proc").iterdir():
        if process.name.isdecimal():
            with suppress(OSError):  # the process has ended since, or is another user's
                if told <= set((process / "environ").read_bytes().split(b"\0")):
                    yield int(process.name)
