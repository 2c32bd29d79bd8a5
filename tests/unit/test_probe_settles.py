"""`probe` on a board that takes other settings, or is opened, while it is looked at."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmfts.cli import direct
from fmfts.config.file import load
from fmfts.sensor import Frame
from fmfts.sensor.probing import once_connected
from fmfts.sensor.source import OPENING, SourceState
from fmfts.sensor.tasks import OPENING_S, PATIENCE_S

WHOLE = Frame(
    0, 0, 0, 0, 0, np.zeros((4, 3), np.int16), np.zeros(4, np.uint16), np.ones(4, bool), np.ones(4, bool), None
)
SILENT = replace(WHOLE, valid=np.zeros(4, bool))


class Played:
    """Gives these frames, some at each look, and the last ones for ever."""

    def __init__(self, *looks: Sequence[Frame]) -> None:
        self.state = SourceState("played")
        self.state.connected = True
        self._looks = list(looks)

    def poll(self, now_ns: int) -> Sequence[Frame]:
        return self._looks.pop(0) if len(self._looks) > 1 else self._looks[0]

    def close(self) -> None:
        pass


@pytest.fixture
def probed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    config = tmp_path / "pad.toml"
    config.write_text('[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\n')

    def probe(*looks: Sequence[Frame]) -> dict[str, Any]:
        monkeypatch.setattr(direct, "open_sources", lambda pads: [(Played(*looks), {0: "left"})])
        monkeypatch.setattr(direct, "PATIENCE_S", 0.1)
        (facts,) = direct.probe(load(config)[0])["pads"]
        return facts

    return probe


def test_sensors_set_up_anew_between_two_looks_are_no_fault(probed: Any) -> None:
    """The first frames are still of the settings before; then all sensors are silent until they are set up."""
    facts = probed([WHOLE, SILENT], [SILENT], [SILENT, WHOLE])
    assert (facts["sound"], facts["faults"]) == (True, [])


def test_sensors_that_stay_silent_after_a_good_frame_are_a_fault(probed: Any) -> None:
    facts = probed([WHOLE, SILENT], [SILENT])
    assert facts["sound"] is False
    assert facts["faults"] == [f"sensor {number} is silent" for number in (1, 2, 3, 4)]


@pytest.mark.parametrize(
    ("reason", "until_s"), [(OPENING, OPENING_S), ("the port does not exist", PATIENCE_S)], ids=["opening", "absent"]
)
def test_running_daemon_is_asked_again_until_its_pads_are_connected(
    monkeypatch: pytest.MonkeyPatch, reason: str, until_s: float
) -> None:
    """A pad whose device is still being opened gets more time than one whose device is absent."""
    now_s, connects_s = 0.0, math.inf

    def sleep(seconds: float) -> None:
        nonlocal now_s
        now_s += seconds

    def facts() -> dict[str, Any]:
        return {"pads": [{"connected": now_s >= connects_s, "reason": reason}]}

    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    monkeypatch.setattr(time, "sleep", sleep)
    assert once_connected(facts) == {"pads": [{"connected": False, "reason": reason}]}
    assert until_s < now_s < until_s + 1.0
    now_s, connects_s = 0.0, until_s - 1.0
    assert once_connected(facts) == {"pads": [{"connected": True, "reason": reason}]}
    assert once_connected(lambda: None) is None
