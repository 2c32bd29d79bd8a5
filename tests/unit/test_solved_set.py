"""From solved presses to a calibration set: the square's symmetries, and fields that are solved back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmfts_calibrate.dataset import read_labelled, standard_pad
from fmfts_calibrate.tracked import FrameSolver
from fmfts_lab.calibration.simulated import rest_field_of
from fmfts_lab.calibration.solved_set import main
from fmfts_simulation.solved_table import COLUMNS, mirrored

# x, y, force, shear x, shear y, dx, dy, dz, axis x, axis y: off the diagonal, on it, and the centre.
SOLVED = np.array(
    [
        [4.0, 2.0, 1.0, 0.1, -0.2, 12.0, 7.0, -500.0, -0.020, -0.010],
        [6.0, 6.0, 1.0, 0.0, 0.0, 15.0, 15.0, -400.0, -0.025, -0.025],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -900.0, 0.0, 0.0],
    ]
)


def written(path: Path, rows: np.ndarray) -> Path:
    np.savetxt(path, rows, delimiter=",", header=",".join(COLUMNS), comments="")
    return path


def test_square_has_eight_symmetries_and_a_press_is_there_once() -> None:
    whole = mirrored(SOLVED)
    assert len(whole) == 8 + 4 + 1
    quarter_turn = whole[(whole[:, 0] == -2.0) & (whole[:, 1] == 4.0)]  # (x, y) → (−y, x)
    np.testing.assert_allclose(quarter_turn, [[-2.0, 4.0, 1.0, 0.2, 0.1, -7.0, 12.0, -500.0, 0.010, -0.020]])


def test_fields_lead_back_to_the_solved_magnet(tmp_path: Path) -> None:
    """The dipole's own error under load is 2 µm and 0.1 mrad."""
    target = tmp_path / "set.csv"
    assert main([str(written(tmp_path / "solved.csv", SOLVED)), "-o", str(target), "--mirrored"]) == 0
    labelled, pad = read_labelled(target), standard_pad()
    assert labelled.press.shape == (13, 5)
    tracked = FrameSolver(pad, rest_field_of(pad), "drifting", 2e-7).solved(labelled.field_t)
    row = int(np.flatnonzero((labelled.press[:, :2] == [4.0, 2.0]).all(axis=1))[0])
    change = tracked.pose[row, :5] - [0.0, 0.0, 12.0, 0.0, 0.0]
    np.testing.assert_allclose(change[:3] * 1e3, SOLVED[0, 5:8], atol=2.0)
    np.testing.assert_allclose(change[3:], SOLVED[0, 8:], atol=2e-4)


def test_file_that_is_no_table_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = tmp_path / "wrong.csv"
    wrong.write_text("x_mm,y_mm\n1,2\n")
    assert main([str(wrong), "-o", str(tmp_path / "set.csv")]) == 65
    assert "wrong.csv: not a table of solved presses" in capsys.readouterr().err
