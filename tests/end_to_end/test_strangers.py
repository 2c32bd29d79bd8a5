"""Thousands of programs that connect to the daemon and do nothing: contacts continue, and the daemon stays up."""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drills.strangers import SILENT, SUBSCRIBED, strangers
from end_to_end.processes import PATIENCE_S, UNTOUCHED_CONFIG, RunningDaemon
from fmfts.bus.door import MOST_CONNECTIONS

MANY = 5000
OF_THIS_PROCESS = 500


@contextmanager
def files(needed: int) -> Iterator[None]:
    """Allows this process to hold the strangers' ends."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < needed:
        pytest.skip(f"this process may open only {hard} files: ulimit -Hn")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, needed), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def wait_for_the_door(path: Path) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while not path.exists():
        assert time.monotonic() < until_s, f"{path} stays closed"
        time.sleep(0.01)


@pytest.mark.parametrize("limit", ["1024:20000", "4096:4096"])
def test_thousands_of_idle_connections_leave_contacts_going_on(tmp_path: Path, limit: str) -> None:
    with (
        files(MANY + OF_THIS_PROCESS),
        RunningDaemon(tmp_path, UNTOUCHED_CONFIG, through=("prlimit", f"--nofile={limit}")) as daemon,
        daemon.subscribe() as messages,
    ):
        for socket, says in (("bus", SUBSCRIBED), ("control", SILENT), ("frames", SUBSCRIBED)):
            wait_for_the_door(tmp_path / socket)
            with strangers(tmp_path / socket, MANY, says) as let_in:
                for _ in range(50):
                    assert messages.receive(PATIENCE_S) is not None, daemon.log.read_text()
                assert daemon.process.poll() is None, daemon.log.read_text()
                assert 0.9 * MOST_CONNECTIONS < let_in < MANY, (socket, daemon.log.read_text())
        assert daemon.wait_for(lambda contact: contact.health == "ok")  # new connections are accepted again
        assert "no other program may connect" in daemon.log.read_text()
