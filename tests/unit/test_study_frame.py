from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from fmfts.config import PadConfig, SimulatedSource
from fmfts_lab.study.harness import Request, Row, Study

COLUMNS = ("method", "error_um", "flagged", "deviation_um")


def request(out: Path, seed: int = 1) -> Request:
    return Request(PadConfig(name="demo", source=SimulatedSource()), out, seed=seed)


def point(measured: list[str], name: str, rows: int = 2) -> Callable[[], list[Row]]:
    def measure() -> list[Row]:
        measured.append(name)
        return [{"method": name, "error_um": 1.5 * row, "flagged": row == 1} for row in range(rows)]

    return measure


def interrupt() -> list[Row]:
    raise KeyboardInterrupt


def interrupted_after(out: Path, names: str) -> None:
    points = {name: point([], name) for name in names}
    with pytest.raises(KeyboardInterrupt):
        Study("drill", request(out), COLUMNS).measure(points | {"broken off": interrupt})


def test_interrupted_study_goes_on_with_points_that_are_missing(tmp_path: Path) -> None:
    interrupted_after(tmp_path, "ab")
    measured: list[str] = []
    points = {name: point(measured, name) for name in "abc"}
    rows = Study("drill", request(tmp_path), COLUMNS).measure(points)
    assert measured == ["c"]
    assert [row["method"] for row in rows] == list("aabbcc")
    assert rows[1] == {"method": "a", "error_um": 1.5, "flagged": True, "deviation_um": None}


def test_point_whose_rows_were_cut_off_is_measured_again(tmp_path: Path) -> None:
    interrupted_after(tmp_path, "ab")
    csv = tmp_path / "drill.csv"
    csv.write_text(csv.read_text()[:-10])
    measured: list[str] = []
    rows = Study("drill", request(tmp_path), COLUMNS).measure({name: point(measured, name) for name in "ab"})
    assert measured == ["b"]
    assert len(rows) == 4


def test_study_with_another_seed_starts_anew(tmp_path: Path) -> None:
    interrupted_after(tmp_path, "a")
    measured: list[str] = []
    Study("drill", request(tmp_path, seed=2), COLUMNS).measure({"a": point(measured, "a")})
    assert measured == ["a"]


def test_summary_names_machine_versions_seed_and_whether_it_is_whole(tmp_path: Path) -> None:
    study = Study("drill", request(tmp_path), COLUMNS)
    written = json.loads((tmp_path / "drill.json").read_text())
    assert written["finished"] is False
    study.conclude({"best": "a"})
    written = json.loads((tmp_path / "drill.json").read_text())
    assert written["finished"] is True
    assert written["best"] == "a"
    assert written["settings"]["seed"] == 1
    assert written["machine"]["processor"]
    assert written["versions"]["fmfts"]


def test_point_without_rows_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'a' has no rows"):
        Study("drill", request(tmp_path), COLUMNS).measure({"a": point([], "a", rows=0)})


def test_chart_is_the_same_file_for_the_same_rows(tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    def drawn() -> bytes:
        figure = Figure()
        figure.subplots().plot([1, 2], [2, 1])
        Study("drill", request(tmp_path), COLUMNS).draw(figure)
        return (tmp_path / "drill.svg").read_bytes()

    assert drawn() == drawn()
    assert (tmp_path / "drill.png").stat().st_size > 1000
