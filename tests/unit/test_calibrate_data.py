"""Errors of a calibration set are named by file, row and column."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from fmfts.cli.main import main
from fmfts.common import exit_codes
from fmfts_calibrate.dataset import read_calibration_set, read_labelled, rest_field, standard_pad
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.labelled_poses import solved
from fmfts_calibrate.tracked import FrameSolver
from fmfts_calibrate.training import Options, calibrate
from fmfts_lab.calibration.simulated import rest_field_of

CALIBRATION = Path(__file__).parents[1] / "data" / "calibration_1.23T.csv"
CONFIG = '[[pad]]\nname = "one"\n[pad.source]\ntype = "simulated"\n'
Rows = list[dict[str, str]]


def written(tmp_path: Path, edit: Callable[[Rows], Rows | None], count: int = 160) -> Path:
    """`count` rows of the calibration set, drawn from all of it, edited."""
    with CALIBRATION.open() as lines:
        rows = list(csv.DictReader(lines))
    rows = [rows[row] for row in np.random.default_rng(1).permutation(len(rows))[:count]]
    rows = edit(rows) or rows
    path = tmp_path / "presses.csv"
    with path.open("w", newline="") as out:
        writer = csv.DictWriter(out, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def without(name: str) -> Callable[[Rows], Rows]:
    return lambda rows: [{key: cell for key, cell in row.items() if key != name} for row in rows]


def at(row: int, name: str, cell: str) -> Callable[[Rows], None]:
    """`row` as a spreadsheet counts, the header being the first."""
    return lambda rows: rows[row - 2].update({name: cell})


def times(factor: float, *names: str) -> Callable[[Rows], Rows]:
    """Columns that begin with `names`."""

    def scaled(row: dict[str, str]) -> dict[str, str]:
        return {key: f"{float(cell) * factor:.9g}" if key.startswith(names) else cell for key, cell in row.items()}

    return lambda rows: [scaled(row) for row in rows]


def copied(source: int, target: int, *names: str) -> Callable[[Rows], None]:
    """Cells of one row put into another: those that begin with `names`."""

    def edit(rows: Rows) -> None:
        for key in rows[0]:
            if key.startswith(names):
                rows[target - 2][key] = rows[source - 2][key]

    return edit


def weakest_labelled_as_strongest(rows: Rows) -> None:
    light, firm = (pick(rows, key=lambda row: float(row["b1z_ut"])) for pick in (max, min))
    light.update({name: firm[name] for name in ("x_mm", "y_mm", "force_n")})


def only_five_values_in_row_7(rows: Rows) -> None:
    for sensor, axis in product("34", "xyz"):
        at(7, f"b{sensor}{axis}_ut", "")(rows)
    at(7, "b2z_ut", "")(rows)


@pytest.mark.parametrize(
    ("edit", "complaint"),
    [
        (without("b3y_ut"), "row 1 has no column b3y_ut"),
        (without("force_n"), "row 1 has no column force_n"),
        (only_five_values_in_row_7, "row 7: 5 of its values are known; a pose needs 6"),
        (at(7, "b2z_ut", "<80"), "row 7, column b2z_ut: '<80': a clipped value is >LIMIT or <-LIMIT"),
        (at(7, "b2z_ut", "nan"), "row 7, column b2z_ut: 'nan' is not a number"),
        (at(9, "x_mm", "nan"), "row 9, column x_mm: 'nan' is not a number"),
        (at(9, "force_n", "much"), "row 9, column force_n: 'much' is not a number"),
        (at(9, "force_n", "-0.4"), "row 9, column force_n: -0.4 N: a press is positive"),
        (at(9, "force_n", "113"), "row 9, column force_n: 113 N is more than a soft pad bears"),
        (at(12, "y_mm", "25"), "row 12, column y_mm: 25 mm is outside the pad, which ends at ±20 mm"),
        (times(0.01, "b"), "were they in gauss?"),
        (times(1e-6, "b"), "were they in tesla?"),
        (times(4.0, "b"), "is it the magnet of the config?"),
        (times(100.0, "b"), "row 2, column b1x_ut"),
        (times(0.01, "b3z_ut"), "column b3z_ut: in most rows 0.00"),
        (times(10.0, "b2x_ut"), "column b2x_ut: "),
        (times(1e-3, "x_mm", "y_mm"), "columns x_mm, y_mm: no place is farther than 0.014 mm from the centre"),
        (copied(20, 30, "b"), "row 30, columns x_mm, y_mm, force_n: the same field as in row 20"),
        (weakest_labelled_as_strongest, "which has the same x_mm, y_mm and force_n"),
        (lambda rows: rows[:149], "149 presses; a calibration needs 150"),
        (lambda rows: [row for row in rows if row["force_n"] == rows[1]["force_n"]] * 4, "column force_n has 1 differ"),
        (lambda rows: [row | {"force_n": "0"} for row in rows], "column force_n is zero in every row"),
    ],
)
def test_bad_row_is_named(tmp_path: Path, edit: Callable[[Rows], Rows | None], complaint: str) -> None:
    path = written(tmp_path, edit)
    with pytest.raises(DataError) as refusal:
        read_calibration_set(path)
    assert str(refusal.value).startswith(str(path))
    assert complaint in str(refusal.value)


def test_swapped_sensors_are_seen_by_field_that_no_magnet_makes(tmp_path: Path) -> None:
    def swap(rows: Rows) -> Rows:
        return [row | {f"b1{axis}_ut": row[f"b2{axis}_ut"] for axis in "xyz"} |
                {f"b2{axis}_ut": row[f"b1{axis}_ut"] for axis in "xyz"} for row in rows]  # fmt: skip

    path = written(tmp_path, swap)
    calibration = read_calibration_set(path)
    solver = FrameSolver(calibration.pad, rest_field_of(calibration.pad), "drifting", 2e-7)
    with pytest.raises(DataError, match=r"presses\.csv: row \d+, .*sensors in the config's order"):
        solved(str(path), calibration, solver)


def test_ambient_field_that_was_left_in_is_named_with_its_size(tmp_path: Path) -> None:
    """Free unknowns would absorb it, and the remanence would be wrong."""
    earth_ut = {"x": 20.0, "y": -10.0, "z": 45.0}

    def add(rows: Rows) -> Rows:
        return [
            row | {key: f"{float(row[key]) + earth_ut[key[2]]:.9g}" for key in row if key[0] == "b"} for row in rows
        ]

    path = written(tmp_path, add)
    calibration = read_calibration_set(path)
    solver = FrameSolver(calibration.pad, rest_field(calibration), "drifting", 2e-7)
    with pytest.raises(DataError, match=r"all sensors share \(20, -10, .*--baseline"):
        solved(str(path), calibration, solver)


@pytest.mark.parametrize(
    ("separator", "complaint"), [(";", "separated by ';'"), ("\t", r"separated by '\\t'"), ("", "is empty")]
)
def test_file_that_is_no_csv_is_refused(tmp_path: Path, separator: str, complaint: str) -> None:
    path = tmp_path / "presses.csv"
    path.write_text(CALIBRATION.read_text().replace(",", separator) if separator else "")
    with pytest.raises(DataError, match=complaint):
        read_calibration_set(path)


def test_unloaded_rows_give_the_rest_field_only(tmp_path: Path) -> None:
    pad = standard_pad(1.28)
    cells = dict(zip((f"b{n}{axis}_ut" for n in range(1, 5) for axis in "xyz"),
                     (f"{value * 1e6:.6f}" for value in rest_field_of(pad).ravel()), strict=True))  # fmt: skip
    labels = {"x_mm": "0", "y_mm": "0", "force_n": "0"}
    calibration = read_calibration_set(written(tmp_path, lambda rows: [labels | cells, *rows, labels | cells]))
    assert len(calibration.press) == 160
    assert calibration.rest_field_t is not None
    np.testing.assert_allclose(calibration.rest_field_t, rest_field_of(pad), atol=1e-11)


def test_without_unloaded_rows_remanence_is_that_of_presses(tmp_path: Path) -> None:
    """Fields 4 % stronger than the drawing's magnet makes: a pad with another magnet."""
    calibration = read_labelled(written(tmp_path, times(1.04, "b")))
    solver = FrameSolver(calibration.pad, rest_field(calibration), "drifting", 2e-7)
    assert solver.remanence_t == pytest.approx(1.04 * 1.23, rel=0.004)  # over a set, the estimates vary by 0.4 %


# --- the verbs ---


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "pad.toml"
    path.write_text(CONFIG)
    return str(path)


def test_verbs_refuse_bad_data_with_65(tmp_path: Path, config: str, capsys: pytest.CaptureFixture[str]) -> None:
    bad = str(written(tmp_path, at(7, "b2z_ut", "?")))
    assert main(["calibrate", bad, "-o", str(tmp_path / "m.onnx"), "--config", config]) == exit_codes.DATA
    assert "row 7, column b2z_ut" in capsys.readouterr().err
    assert not (tmp_path / "m.onnx").exists()
    assert main(["evaluate", bad, "--config", config]) == exit_codes.DATA
    assert "row 7, column b2z_ut" in capsys.readouterr().err
    assert main(["evaluate", bad, "--config", config, "--model", "absent.onnx"]) == exit_codes.DATA
    assert "absent.onnx: it cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--place-sd-mm", "0.05"], "--place-sd-mm: is for --correct alone"),
        (["--scale-sd", "0"], "--scale-sd: is for --correct alone"),
        (["--correct", "--place-sd-mm", "6"], "--place-sd-mm is 6: more than 0, up to 5 mm"),
        (["--correct", "--scale-sd", "0.4"], "--scale-sd is 0.4: a share from 0 to 0.3; .*weigh that pad"),
    ],
)
def test_deviations_of_presses_belong_to_correct_alone(
    tmp_path: Path, config: str, capsys: pytest.CaptureFixture[str], words: list[str], complaint: str
) -> None:
    data, made = str(written(tmp_path, lambda rows: None)), tmp_path / "m.onnx"
    assert main(["calibrate", data, "-o", str(made), "--config", config, *words]) == exit_codes.USAGE
    assert re.search(complaint, capsys.readouterr().err)
    assert not made.exists()


def test_target_that_cannot_be_written_is_refused_before_anything_is_solved(
    tmp_path: Path, config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    data = str(written(tmp_path, lambda rows: None))
    absent, report, folder = tmp_path / "absent" / "m.onnx", tmp_path / "m.json", tmp_path / "folder.onnx"
    folder.mkdir()
    unwritable, refused = exit_codes.UNWRITABLE, exit_codes.DATA
    for target, complaint, code in (
        (absent, f"{absent}: No such file or directory: make its folder first", unwritable),
        (report, "choose another", refused),
        (folder, "directory", unwritable),
    ):
        assert main(["calibrate", data, "-o", str(target), "--config", config]) == code
        said = capsys.readouterr().err
        assert complaint in said
        assert "solving" not in said


def test_slight_shear_of_a_real_gauge_is_ignored(tmp_path: Path) -> None:
    """2 mN in each row, on forces from 283 mN; a sheared press remains one."""
    path = written(tmp_path, lambda rows: [row | {"shear_x_n": "0.002", "shear_y_n": "-0.002"} for row in rows])
    assert not read_calibration_set(path).press[:, 3:].any()
    path = written(tmp_path, lambda rows: [row | {"shear_x_n": "0.1", "shear_y_n": "0"} for row in rows])
    sheared = read_calibration_set(path)
    assert sheared.press[:, 3].all()
    with pytest.raises(DataError, match="columns shear_x_n, shear_y_n: every row has shear"):
        calibrate(str(path), sheared, Options(hidden=4), lambda line: None)


@pytest.mark.long
def test_calibrated_model_serves_and_its_report_stands_beside_it(
    tmp_path: Path, config: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the verb to the verb, small: layers of 8 know places to 0.1 mm within 8 mm, and say how well."""
    data = str(written(tmp_path, lambda rows: None, count=225))
    target = tmp_path / "small.onnx"
    arguments = ["calibrate", data, "-o", str(target), "--config", config, "--hidden", "8", "--presses", "1500"]
    assert main(arguments) == 0
    told = capsys.readouterr().err
    assert "calibrate: training" in told
    bridge = re.search(r"within 11 mm of the centre and from 0.5 N, .* x (\S+) mm, y (\S+) mm, force (\S+) N", told)
    assert bridge is not None
    report = json.loads(target.with_suffix(".json").read_text())
    assert report["hidden"] == 8
    first = target.read_bytes()
    assert main(arguments) == 0
    assert target.read_bytes() == first  # the same weights, to the bit
    capsys.readouterr()
    plot = tmp_path / "errors.png"
    again = ["evaluate", data, "--model", str(target), "--config", config, "--json", "--plot", str(plot)]
    assert main(again) == 0
    out, err = capsys.readouterr()
    assert "the model was made from these very presses" in err
    facts = json.loads(out)
    assert facts["model"] == report["model"]
    on_new = report["on_new_presses_with_noise"][0]
    assert float(bridge[1]) < on_new["mae_x_mm"], "light presses and the rim are worse"
    # 0.05 mm and 0.012 N; layers of 4 leave 0.07 mm and 0.11 N: the force on a slab that stiffens is more curved than
    # the place.
    centre = next(row for row in facts["regions"] if row["region"] == "within 8 mm")
    assert centre["mae_x_mm"] < 0.1
    assert centre["mae_force_n"] < 0.03
    assert plot.read_bytes().startswith(b"\x89PNG")
    _is_judged_as_the_pad_runs_it(data, target, report["model"], tmp_path, capsys)
    _is_told_that_shear_is_unknown(target, tmp_path, capsys)


def _is_judged_as_the_pad_runs_it(
    data: str, target: Path, model: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`evaluate` without --model takes model, refine and friction from the file, as `run` does."""
    found = []
    for refine, friction in (("false", 0.0), ("true", 0.0), ("false", 0.3)):
        file = folder / "runs.toml"
        contact = f'[pad.contact]\nmodel = "{target.name}"\nrefine = {refine}\nfriction = {friction}\n'
        file.write_text('[[pad]]\nname = "standard"\n[pad.source]\ntype = "simulated"\n' + contact)
        assert main(["evaluate", data, "--config", str(file), "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    plain, refined, shearing = found
    assert plain["model"] == refined["model"] == model
    assert (refined["refine"], shearing["friction"]) == (True, 0.3)
    everywhere, again, wider = (one["regions"][0] for one in found)
    # Two steps toward the most likely press: a network of 8 does not reach it by itself.
    assert again["mae_force_n"] < everywhere["mae_force_n"]
    # The model that ships describes the effect of a shearing finger on the standard pad.
    assert wider["in_sd_force_n"] < 0.8 * everywhere["in_sd_force_n"]


def _is_told_that_shear_is_unknown(target: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fmfts.contact.structure.DEFAULT_PATH", target)  # this model was made without --sheared, too
        assert main(["check-config", "--config", str(folder / "runs.toml")]) == 0
    assert "friction = 0.3 has no effect: the contact model was made without --sheared" in capsys.readouterr().err


def test_standard_pad_needs_no_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    data = str(written(tmp_path, lambda rows: None, count=225))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FMFTS_CONFIG", raising=False)
    monkeypatch.setattr("fmfts.config.file.DEFAULT_PATHS", (tmp_path / "absent.toml",))
    assert main(["evaluate", data]) == 0
    assert "refine = false, friction = 0.3" in capsys.readouterr().out
