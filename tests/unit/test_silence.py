"""When a pad is called silent: not while its frames lie unread, because this computer was busy with something else."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

from fmfts.config import Config, PadConfig, SimulatedSource
from fmfts.runtime import channel
from fmfts.runtime.daemon import Daemon

STALL_NS = 200_000_000  # longer than a pad may be silent


@pytest.fixture
def daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Daemon:
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return Daemon(Config(pad=[PadConfig(name="left", source=SimulatedSource(finger="none"))]))


@pytest.fixture
def stall(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """The time after one more stall, during which nothing was done; there is no other time."""
    times = count(time.monotonic_ns(), STALL_NS)

    def stall() -> int:
        now_ns = next(times)
        monkeypatch.setattr(channel, "time", SimpleNamespace(monotonic_ns=lambda: now_ns, time_ns=time.time_ns))
        return now_ns

    return stall


def test_frames_that_came_while_loop_stood_still_are_no_silence(daemon: Daemon, stall: Callable[[], int]) -> None:
    with daemon:
        (left,) = daemon._channels.values()
        daemon._serve(left.source, stall())
        for _ in range(3):
            daemon._tell_silence(stall())
            assert left.health == "ok"


def test_source_that_has_nothing_to_read_is_silent(
    daemon: Daemon, stall: Callable[[], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    with daemon:
        (left,) = daemon._channels.values()
        daemon._serve(left.source, stall())
        monkeypatch.setattr(left.source, "poll", lambda now_ns: ())
        daemon._tell_silence(stall())
        assert left.health == "stale"
