"""Geometry from the fields of a real pad, without labels: github.com/TheEngineRoom-UniGe/Melexis_Tactile_Sensor.

One magnet in elastomer above four pixels of two axes (x and z). The repository has no licence: its files are not here;
FMFTS_RECORDED names a folder with a folder melexis that has them (lab/results/real.md).
"""

from __future__ import annotations

from pathlib import Path

import pytest
from recorded_files import FOLDER, needs

from fmfts_lab.real.sold_sensor import SESSIONS
from fmfts_lab.real.unlabelled import first_session, learned_from, learned_from_rough, left_t, refined, session_t


@pytest.fixture
def folder() -> Path:
    for file, _ in SESSIONS.values():
        needs(file)
    return FOLDER


def test_learned_geometry_explains_left_out_presses(folder: Path) -> None:
    """Fields of 5 to 33 mT, to 0.2 %; another day needs its own fields, and no labels."""
    beginning, later = first_session(folder)
    learned, another_day = learned_from(beginning), session_t("second", folder)
    assert learned.open == []
    assert left_t(learned, later) < 6e-5
    assert left_t(refined(learned, another_day), another_day) < 5e-5


@pytest.mark.long
def test_rough_starts_end_right_or_say_that_they_are_ambiguous(folder: Path) -> None:
    beginning, later = first_session(folder)
    found = [learned_from_rough(seed, beginning) for seed in range(20)]
    right = [left_t(learned, later) < 6e-5 for learned in found if learned is not None]
    assert all(right)
    assert len(right) >= 15
