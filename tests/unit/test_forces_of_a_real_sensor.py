"""Forces across two sessions of a sensor that was sold: github.com/TheEngineRoom-UniGe/Melexis_Tactile_Sensor.

One magnet in an elastomer over four pixels of two axes each, and a load cell. The repository has no licence:
its files are not here; FMFTS_RECORDED names a folder with a folder melexis that has them (lab/results/real.md).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_files import FOLDER, needs

from fmfts_lab.real.other_day import BOTH, SOFTENING, UNCLIPPED, corrected, rows_of
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


@pytest.mark.long
def test_calibrate_is_honest_on_another_day_and_a_network_is_not() -> None:
    """By rest alone, and by one or five presses of known force: lab/results/real.md has the figures."""
    for file, _ in SESSIONS.values():
        needs(file)
    every = list(rows_of(FOLDER))
    rows = [row for row in every if row.way != UNCLIPPED]
    by_rest = [row for row in rows if row.known == 0]
    assert len(rows) == 6 * 2 * 4
    for row in (row for row in rows if row.states_deviations and row.method != SOFTENING):
        assert 0.90 <= row.within_2 <= 0.995, row
        assert row.beyond_5 <= 0.003, row
    for row in (row for row in by_rest if not row.states_deviations):
        assert row.within_2 < 0.90, row
        assert row.beyond_5 > 0.03, row
    for number in range(2):
        field, pose, weighed_n, softening, network, polynomial = (row.size_n for row in by_rest[number::2])
        assert softening < weighed_n < field < 0.42 < min(network, polynomial)
        # Measured 0.506 and 0.332, with a play of 5 %: the pose route misses 0.42 on the first day (real.md).
        assert pose < (0.531, 0.349)[number]
    weighed = [row for row in by_rest if row.method == BOTH]
    for row, most in zip(weighed, ((0.11, 0.12, 0.32), (0.11, 0.12, 0.335)), strict=True):  # asked: z 0.32 of both
        assert all(one <= limit for one, limit in zip(row.rms_n, most, strict=True)), row
        assert row.beyond_5 <= 0.001
    unclipped = next(row for row in every if row.method == BOTH and row.way == UNCLIPPED)
    assert all(one <= limit for one, limit in zip(unclipped.rms_n, (0.10, 0.10, 0.26), strict=True))


def test_known_press_scales_forces_within_the_stated_prior() -> None:
    found, variance = np.array([[0.2, -0.1, 4.0]]), np.full((1, 3), 1e-12)
    np.testing.assert_allclose(corrected(found, 1.1 * found, variance), 1.1 * np.eye(3), rtol=1e-6)
    doubtful = corrected(found, 1.1 * found, np.full((1, 3), 4.0))
    assert doubtful[0, 0] == doubtful[2, 2] < 1.001


def test_five_known_presses_find_what_mixes_the_directions() -> None:
    mixes = np.eye(3) + np.random.default_rng(1).normal(0.0, 0.03, (3, 3))
    found = np.random.default_rng(2).normal(0.0, 2.0, (5, 3))
    np.testing.assert_allclose(corrected(found, found @ mixes.T, np.full((5, 3), 1e-10)), mixes, atol=1e-6)
