"""A value that is clipped or missing is left out of a calibration set alone, and not its sensor or its row."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fmfts.cli.main import main
from fmfts.common.names import field_columns
from fmfts_calibrate.dataset import CalibrationSet, read_calibration_set
from fmfts_calibrate.labelled_poses import solved, solver_of
from fmfts_calibrate.tracked import Tracked

CALIBRATION = Path(__file__).parents[1] / "data" / "calibration_1.23T.csv"
NAMES = field_columns(4)
Edit = Callable[[int, dict[str, str]], None]


def _written(path: Path, edit: Edit, count: int = 200) -> Path:
    with CALIBRATION.open() as lines:
        rows = list(csv.DictReader(lines))
    rows = [rows[row] for row in np.random.default_rng(1).permutation(len(rows))[:count]]
    for number, row in enumerate(rows):
        edit(number, row)
    with path.open("w", newline="") as out:
        writer = csv.DictWriter(out, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def _poses(path: Path) -> tuple[CalibrationSet, Tracked]:
    calibration = read_calibration_set(path)
    return calibration, solved(str(path), calibration, solver_of(calibration, "constant", 2e-7))


def _empty_one(number: int, row: dict[str, str]) -> None:
    row[NAMES[number % 12]] = ""


def _clip_one(number: int, row: dict[str, str]) -> None:
    """The chip ended 2 % below what it would have read."""
    name = NAMES[number % 12]
    value = 0.98 * float(row[name])
    row[name] = f">{value:.4f}" if value > 0.0 else f"<{value:.4f}"


@pytest.mark.parametrize("edit", [_empty_one, _clip_one])
def test_missing_value_does_not_shift_the_pose(tmp_path: Path, edit: Edit) -> None:
    """The set has no noise, and its magnet is no exact dipole: a few of a frame's deviations."""
    _, whole = _poses(_written(tmp_path / "whole.csv", lambda *_: None))
    calibration, fewer = _poses(_written(tmp_path / "fewer.csv", edit))
    assert np.isnan(calibration.field_t).sum() == 200
    off = (fewer.pose[:, :5] - whole.pose[:, :5]) / fewer.deviation
    assert np.sqrt(np.mean(off**2)) < 3.0
    # A sensor excluded as a whole would cost much more than a twelfth of the information.
    assert 1.0 < np.median(fewer.deviation / whole.deviation) < 1.1
    assert (fewer.deviation >= whole.deviation * 0.999).all()


def test_missing_axis_widens_deviations_everywhere(tmp_path: Path) -> None:
    """Chips of two axes: also in the training poses, for which no field was measured."""

    def two_axes(_: int, row: dict[str, str]) -> None:
        row.update({name: "" for name in NAMES if name[2] == "y"})

    _, whole = _poses(_written(tmp_path / "whole.csv", lambda *_: None))
    calibration, fewer = _poses(_written(tmp_path / "fewer.csv", two_axes))
    expected = solver_of(calibration, "constant", 2e-7).at(fewer.pose)
    np.testing.assert_allclose(expected.deviation, fewer.deviation, rtol=0.02)
    assert np.median(fewer.deviation / whole.deviation) > 1.1


def test_evaluate_reads_values_one_by_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    errors = []
    for edit in (lambda *_: None, _empty_one, _clip_one):
        path = _written(tmp_path / "test.csv", edit)
        assert main(["evaluate", str(path), "--model", "default", "--json"]) == 0
        errors.append(json.loads(capsys.readouterr().out)["regions"][0]["rmse_force_n"])
    assert errors[1] < 1.5 * errors[0]
    assert errors[2] < 1.5 * errors[0]
