"""Geometry from the fields of a real pad, without labels: github.com/TheEngineRoom-UniGe/Melexis_Tactile_Sensor.

One magnet in elastomer above four pixels of two axes (x and z). The repository has no licence: its files are not here;
FMFTS_RECORDED names a folder with a folder melexis that has them (lab/results/real.md).
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from recorded_files import FOLDER, needs

from fmfts.pad import rotation_from_vector
from fmfts_lab.real.figures import unlabelled
from fmfts_lab.real.sold_sensor import PIXELS, SESSIONS
from fmfts_lab.real.unlabelled import (
    UNTOUCHED,
    Left,
    first_session,
    learned_from,
    learned_from_rough,
    left_of_sessions,
    left_t,
    rms_of,
    sketch,
    sketches_line,
)
from fmfts_simulation.cylinder import cylinder_field


@pytest.fixture
def folder() -> Path:
    for file, _ in SESSIONS.values():
        needs(file)
    return FOLDER


def test_learned_geometry_explains_left_out_presses(folder: Path) -> None:
    """Fields of 5 to 33 mT, to 0.2 %; another day needs its own fields, and no labels."""
    assert learned_from(first_session(folder)[0]).open == []
    judged = [one for one in left_of_sessions(folder) if one.most_ut is not None]
    assert len(judged) == 2
    assert all(one.rms_ut <= one.most_ut for one in judged if one.most_ut)


@pytest.mark.long
def test_rough_starts_end_right_or_say_that_they_are_ambiguous(folder: Path) -> None:
    beginning, later = first_session(folder)
    found = [learned_from_rough(seed, beginning) for seed in range(20)]
    right = [rms_of(left_t(learned, later)) <= 6e-5 for learned in found if learned is not None]
    assert all(right)
    assert len(right) >= 15


# A made-up recording: the exact field of a cylinder (fmfts_simulation/cylinder.py) above four chips that are not where
# the sketch says.
ROWS, NOISE_MT = 60, 0.03


def made_up(folder: Path) -> None:
    """Two sessions. In the second one the magnet is broken in two."""
    random = np.random.default_rng(7)
    pad = sketch()
    places_m = pad.sensors.position_m + random.uniform(-2e-4, 2e-4, (4, 3))
    turns = [rotation_from_vector(one) for one in np.radians(random.uniform(-3.0, 3.0, (4, 3)))]
    for name, (file, _) in SESSIONS.items():
        path = folder / file
        path.parent.mkdir(exist_ok=True)
        pressed = (np.arange(ROWS + UNTOUCHED) >= UNTOUCHED)[:, None]
        steps_m = pressed * random.uniform((-4e-4, -4e-4, -6e-4), (4e-4, 4e-4, 0.0), (len(pressed), 3))
        axes = np.array([0.0, 0.0, 1.0]) + pressed * random.normal(0.0, 0.06, (len(pressed), 3)) * [1.0, 1.0, 0.0]
        with path.open("w", newline="") as lines:
            writer = csv.writer(lines)
            writer.writerow([f"B{axis}{pixel}" for pixel in PIXELS for axis in "xz"])
            for step_m, axis in zip(steps_m, axes / np.linalg.norm(axes, axis=1, keepdims=True), strict=True):
                field_t = cylinder_field(places_m, pad.rest_position_m + step_m, axis, pad.magnet)
                if name == "second":
                    half_m = pad.rest_position_m - step_m + np.array([1.5e-3, 0.0, 1e-3])
                    field_t = field_t + cylinder_field(places_m, half_m, axis, pad.magnet)
                own_mt = 1e3 * np.einsum("nij,ni->nj", turns, field_t)[:, [0, 2]]
                writer.writerow([f"{one:.4f}" for one in (own_mt + random.normal(0.0, NOISE_MT, own_mt.shape)).ravel()])


def test_command_judges_a_made_up_recording(tmp_path: Path) -> None:
    made_up(tmp_path)
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in unlabelled(tmp_path).lines[2:]]
    assert [row[3] for row in rows] == ["reached", "", "missed"]
    first, by_first, own = (float(row[1]) for row in rows)
    assert 15.0 < first < 45.0 < 50.0 < own < by_first


def test_geometry_that_leaves_too_much_is_a_miss() -> None:
    left = np.full((3, 4, 3), 61e-6)
    left[0, 0, 0] = np.nan
    assert Left.of("any", left, 60.0).cells == ("any", "61", "60", "missed")
    assert Left.of("any", 0.9 * left, 60.0).cells == ("any", "55", "60", "reached")


def test_session_that_no_geometry_explains_is_refused() -> None:
    assert Left("any", np.nan, np.empty(0), 50.0).cells == ("any", "–", "50", "refused")


def test_line_of_sketches_counts_right_wrong_and_ambiguous_ones() -> None:
    assert sketches_line(np.array([51.0, 60.0, 61.2, np.nan])) == "| 4 | 2 | 61 | 1 |"
    assert sketches_line(np.array([np.nan])) == "| 1 | 0 | – | 1 |"
