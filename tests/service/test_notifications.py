"""What the real daemon tells systemd, and when."""

from __future__ import annotations

import select
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from end_to_end.processes import BRIDGE_CONFIG, PATIENCE_S, RunningDaemon
from fmfts_client import UnreachableError

SIMULATED = """
[[pad]]
name = "left"
[pad.source]
type = "simulated"
"""
WATCHDOG_S = 3.0  # of the unit


@pytest.fixture
def systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """systemd's end of $NOTIFY_SOCKET, for daemons that are started from now on."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.settimeout(PATIENCE_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield listening


def next_with(systemd: socket.socket, start: str) -> str:
    heard, until = [], time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        text = systemd.recv(4096).decode()
        if text.startswith(start):
            return text
        heard.append(text)
    raise AssertionError(f"no {start} within {PATIENCE_S:.0f} s, but {heard}")


def longest_pause_s(systemd: socket.socket, seconds: float) -> float:
    """Between signs of life for the watchdog."""
    longest, last, end = 0.0, time.monotonic(), time.monotonic() + seconds
    while last < end:
        next_with(systemd, "WATCHDOG=1")
        now = time.monotonic()
        longest, last = max(longest, now - last), now
    return longest


def test_systemd_gets_ready_when_sockets_are_bound(tmp_path: Path, systemd: socket.socket) -> None:
    with RunningDaemon(tmp_path, SIMULATED, wait=False) as daemon:
        next_with(systemd, "READY=1")
        assert daemon.request("pads")["pads"]


@pytest.mark.real_time
def test_systemd_status_shows_the_true_rate(tmp_path: Path, systemd: socket.socket) -> None:
    with RunningDaemon(tmp_path, SIMULATED):
        # The first ones are sent before the pad is up, and before there is an interval for the rate.
        told = ""
        for _ in range(20):
            told = next_with(systemd, "STATUS=")
            if told.startswith("STATUS=1 of 1 pads ok at ") and not told.endswith(" at 0 Hz"):
                break
        assert told.startswith("STATUS=1 of 1 pads ok at ")
        assert 100 < float(told.split()[-2]) < 230


@pytest.mark.real_time
def test_absent_hardware_is_reported_and_watchdog_is_fed(tmp_path: Path, systemd: socket.socket) -> None:
    with RunningDaemon(tmp_path, BRIDGE_CONFIG.format(port=tmp_path / "nothing")):
        assert longest_pause_s(systemd, 2.0) < WATCHDOG_S / 2
        told = next_with(systemd, "STATUS=")
    assert told.startswith("STATUS=0 of 1 pads ok; left: disconnected for ")
    assert "does not exist (is the board plugged in?)" in told


def states_of(process: int) -> str:
    """Of all its threads, as in proc_pid_stat(5): T if it is stopped."""
    stats = [path.read_text() for path in Path(f"/proc/{process}/task").glob("*/stat")]
    return "".join(stat.rpartition(") ")[2][0] for stat in stats)


def test_daemon_that_hangs_feeds_no_watchdog(tmp_path: Path, systemd: socket.socket) -> None:
    with RunningDaemon(tmp_path, SIMULATED) as daemon:
        daemon.process.send_signal(signal.SIGSTOP)
        until = time.monotonic() + PATIENCE_S
        while set(states_of(daemon.process.pid)) != {"T"}:
            assert time.monotonic() < until
        while select.select([systemd], [], [], 0.0)[0]:
            systemd.recv(4096)
        assert not select.select([systemd], [], [], 1.0)[0]
        daemon.process.send_signal(signal.SIGCONT)
        next_with(systemd, "WATCHDOG=1")


def test_stopping_is_reported_and_no_request_is_answered_after(tmp_path: Path, systemd: socket.socket) -> None:
    with RunningDaemon(tmp_path, SIMULATED) as daemon:
        assert daemon.stop() == 0
        next_with(systemd, "STOPPING=1")
        with pytest.raises(UnreachableError):
            daemon.request("pads", timeout_s=0.5)
