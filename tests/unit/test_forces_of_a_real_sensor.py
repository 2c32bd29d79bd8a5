"""Forces across two sessions of a sensor that was sold: github.com/TheEngineRoom-UniGe/Melexis_Tactile_Sensor.

One magnet in an elastomer over four pixels of two axes each, and a load cell. The repository has no licence:
its files are not here; FMFTS_RECORDED names a folder with a folder melexis that has them (lab/results/real.md).
"""

from __future__ import annotations

from pathlib import Path

import pytest
from recorded_files import needs

from fmfts_lab.real.sold_sensor import SESSIONS, written_session
from fmfts_skin.calibrate.force_command import make_force_file


def test_forces_of_another_session(tmp_path: Path) -> None:
    """Each session by a model of the other alone. The deviations hold; what the errors miss of the aim: real.md."""
    sessions = [written_session(name, needs(file), tmp_path) for name, (file, _) in SESSIONS.items()]
    report = make_force_file(sessions, tmp_path / "both.force", None, None, lambda _: None)
    rows = {row["rows"]: row for row in report["routes"][0]["rows"]}
    assert rows["all"]["answered"] == 1909 + 660
    for session in ("session first", "session second"):
        assert 0.90 <= rows[session]["within_2"] <= 0.99
    assert rows["all"]["beyond_5"] <= 0.001
    for name, most in (("session first", (0.15, 0.10, 0.38)), ("session second", (0.12, 0.11, 0.40))):
        found = [rows[name][f"rms_{axis}_n"] for axis in "xyz"]
        assert all(one <= limit for one, limit in zip(found, most, strict=True)), found
    unclipped = [rows["no value clipped"][f"rms_{axis}_n"] for axis in "xyz"]
    assert unclipped == pytest.approx([0.121, 0.074, 0.284], abs=0.01)
