"""Thousands of programs that connect to the daemon and do nothing: contacts go on, and the daemon stays."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drills.strangers import SILENT, SUBSCRIBED, strangers
from end_to_end.processes import UNTOUCHED_CONFIG, RunningDaemon

MANY = 5000
OF_THIS_PROCESS = 500


@contextmanager
def files(needed: int) -> Iterator[None]:
    """Lets this process hold the strangers' ends."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < needed:
        pytest.skip(f"this process may open only {hard} files: ulimit -Hn")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, needed), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize(
    ("limit", "all_come_in"),
    [
        pytest.param(f"1024:{4 * MANY}", True, id="the daemon takes what it is permitted"),
        pytest.param("4096:4096", False, id="more strangers than the daemon may have"),
    ],
)
def test_thousands_of_idle_connections_leave_contacts_going_on(tmp_path: Path, limit: str, all_come_in: bool) -> None:
    with (
        files(MANY + OF_THIS_PROCESS),
        RunningDaemon(tmp_path, UNTOUCHED_CONFIG, through=("prlimit", f"--nofile={limit}")) as daemon,
        daemon.subscribe() as messages,
    ):
        for socket, says in (("bus", SUBSCRIBED), ("control", SILENT), ("frames", SUBSCRIBED)):
            with strangers(tmp_path / socket, MANY, says) as let_in:
                for _ in range(50):
                    assert messages.receive(timeout_s=10.0) is not None, daemon.log.read_text()
                assert daemon.process.poll() is None, daemon.log.read_text()
                if all_come_in:
                    assert let_in == MANY, (socket, daemon.log.read_text())
        assert daemon.wait_for(lambda contact: contact.health == "ok")  # the door is open again
        assert all_come_in != ("no other program may connect" in daemon.log.read_text())
