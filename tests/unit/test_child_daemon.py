"""A daemon that a demo or a report runs for a moment: what is left when it cannot be started."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from fmfts.service.child import child_daemon


def test_daemon_that_cannot_be_started_leaves_no_signal_blocked(tmp_path: Path) -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    with pytest.raises(ValueError, match="null byte"), child_daemon(tmp_path / "a.toml", tmp_path, {"A": "\0"}):
        pytest.fail("it was started")
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before
