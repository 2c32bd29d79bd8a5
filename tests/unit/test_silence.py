"""When a pad is called silent: not while its frames lie unread, because this computer was busy with something else."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from fmfts.config import Config, PadConfig, SimulatedSource
from fmfts.running.daemon import Daemon

STALL_S = 0.2  # longer than a pad may be silent


@pytest.fixture
def daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Daemon:
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return Daemon(Config(pad=[PadConfig(name="left", source=SimulatedSource(finger="none"))]))


def test_frames_that_came_while_the_loop_stood_still_are_no_silence(daemon: Daemon) -> None:
    with daemon:
        (channel,) = daemon._channels.values()
        daemon._serve(channel.source, time.monotonic_ns())
        for _ in range(3):
            time.sleep(STALL_S)
            daemon._tell_silence(time.monotonic_ns())
            assert channel.health == "ok"


def test_a_source_that_has_nothing_to_read_is_silent(daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
    with daemon:
        (channel,) = daemon._channels.values()
        daemon._serve(channel.source, time.monotonic_ns())
        monkeypatch.setattr(channel.source, "poll", lambda now_ns: ())
        time.sleep(STALL_S)
        daemon._tell_silence(time.monotonic_ns())
        assert channel.health == "stale"
