"""`probe` on a board that takes other settings while it is looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmfts.cli import direct
from fmfts.config.file import load
from fmfts.sensor import Frame
from fmfts.sensor.source import SourceState

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
