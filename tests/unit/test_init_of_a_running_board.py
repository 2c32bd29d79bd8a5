"""`init` waits until the board has said who it is, whatever the board sends before."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmfts.cli.init_config import _asked
from fmfts.config import BridgeSource
from fmfts.sensor.source import SourceState


class RunningBoard:
    """Connected, as its frames come; a report of its counters came first, its hello comes at the third poll."""

    def __init__(self) -> None:
        self.state = SourceState("a board", connected=True, reason="", board={"transmit_dropped": 0})
        self.polls = 0

    def poll(self, _now_ns: int) -> list[object]:
        self.polls += 1
        if self.polls == 3:
            self.state.board["uid"] = "00112233445566778899aabb"
        return []

    def close(self) -> None:
        pass


def test_board_that_reports_its_counters_first_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmfts.sources.open_sources", lambda _pads: [(RunningBoard(), 0)])
    board, _reason = _asked(BridgeSource(port=str(tmp_path / "board")))
    assert board["uid"] == "00112233445566778899aabb"
