"""eFlesh's recordings: their importer and benchmark, with a recording that is made here."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from fmfts_calibrate.field_table import write
from fmfts_lab.bench.eflesh import another_day, converted, run
from fmfts_lab.eflesh import main
from fmfts_skin.calibrate.field_evaluate import evaluate_field
from fmfts_skin.calibrate.field_set import read_field_set
from skin.skin_pad import presses, skin_field

NAMES = [f"b{sensor}{axis}_ut" for sensor in range(1, 6) for axis in "xyz"]


def recorded(path: Path, stage_mm: np.ndarray, field: np.ndarray, gauge_g: np.ndarray | None = None) -> Path:
    """A file as eFlesh's are: t_s, the stage, a gauge if any, the fields."""
    columns = {"t_s": np.arange(len(field)) / 10.0} | dict(zip(("x_mm", "y_mm", "z_mm"), stage_mm.T, strict=True))
    if gauge_g is not None:
        columns["gauge_g"] = gauge_g
    columns |= dict(zip(NAMES, field.T, strict=True))
    with path.open("w") as out:
        write({name: [repr(float(one)) for one in values] for name, values in columns.items()}, out)
    return path


def pressed(path: Path, seed: int) -> Path:
    """Ten presses at one place, as deep as 3 mm; a newton is 0.1 mm; every other gauge reading is absent."""
    depth = 3.0 * np.sin(np.linspace(0.0, 10.0 * np.pi, 800)) ** 2
    field = skin_field(np.column_stack([np.full((800, 2), 2.0), depth]))
    field += np.random.default_rng(seed).normal(0.0, 5.0, field.shape)
    gauge = np.where(np.arange(800) % 2, -1.0, depth / 0.1 / 9.80665e-3)
    stage = np.column_stack([np.full(800, 315.0), np.full(800, -100.0), 288.0 - depth])
    return recorded(path, stage, field, gauge)


def gridded(path: Path) -> Path:
    press = presses(1200, 31)
    field = skin_field(press) + np.random.default_rng(32).normal(0.0, 5.0, (1200, 15))
    return recorded(path, np.array([289.0, -100.0, 145.0]) + press * [1.0, 1.0, -1.0], field)


def test_pressed_recording_has_newtons_and_rests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, target = pressed(tmp_path / "eflesh_normal_1.csv", 30), tmp_path / "set.csv"
    monkeypatch.setattr("sys.argv", ["eflesh", str(source), "-o", str(target)])
    main()
    data = read_field_set(target)
    assert data.axes == ("force_n",)
    assert data.recordings == ("eflesh_normal_1",)
    assert data.contact.max() == pytest.approx(30.0, abs=0.1)
    assert data.rest.any()
    assert (data.contact[data.rest] == 0.0).all()
    assert (data.contact >= 0.0).all(), "rows without a gauge reading are left out"


def test_gridded_recording_has_places_about_its_middle_and_depths(tmp_path: Path) -> None:
    data = converted(gridded(tmp_path / "eflesh_spatial_1.csv"))
    press = presses(1200, 31)
    middle = (press[:, :2].min(axis=0) + press[:, :2].max(axis=0)) / 2.0
    np.testing.assert_allclose(data.contact[:, :2], press[:, :2] - middle, atol=1e-3)
    np.testing.assert_allclose(data.contact[:, 2], press[:, 2] - press[:, 2].min(), atol=1e-3)
    assert not data.rest.any()


def test_set_of_many_places_with_a_gauge_has_no_forces(tmp_path: Path) -> None:
    press = presses(200, 35)
    path = recorded(tmp_path / "eflesh_spatial_9.csv", press * [1.0, 1.0, -1.0], skin_field(press), np.full(200, -1.0))
    assert converted(path).axes == ("x_mm", "y_mm", "depth_mm")


def test_file_of_another_kind_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "other.csv"
    other.write_text("a,b\n1,2\n")
    monkeypatch.setattr("sys.argv", ["eflesh", str(other), "-o", str(tmp_path / "set.csv")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 65


def test_benchmark_says_which_recordings_are_absent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pressed(tmp_path / "eflesh_normal_1.csv", 33)
    pressed(tmp_path / "eflesh_normal_2.csv", 34)
    run(Namespace(recordings=tmp_path))
    said = capsys.readouterr().out
    assert "Shear: left out" in said
    assert "eflesh_spatial_1.csv" in said
    row = next(line for line in said.splitlines() if line.startswith("| trained on recording 1, tested on 2"))
    assert float(row.split("|")[2]) < 1.0


@pytest.mark.long
def test_simulated_day_differs_from_the_table(tmp_path: Path) -> None:
    from fmfts_skin.calibrate.field_fit import make_response

    data = converted(gridded(tmp_path / "eflesh_spatial_1.csv"))
    response = make_response(data, "skin", lambda line: None)
    changed = another_day(response, data)
    learnt, recorded_only = (evaluate_field(response, changed, "test", learn) for learn in (True, False))
    off = [np.hypot(*(one.found - one.contact)[:, :2].T) for one in (learnt, recorded_only)]
    assert np.median(off[0]) < 0.5 * np.median(off[1])
