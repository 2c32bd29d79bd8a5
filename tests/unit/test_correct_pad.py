"""A few presses correct the contact model of a pad with one magnet: pads of another solver, and what is refused."""

from __future__ import annotations

import csv
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from fmfts.contact import ContactModel
from fmfts.contact.contract import OUTPUT_ORDER
from fmfts.contact.inference import NetworkInference
from fmfts.pipeline.configured import load_contact_model
from fmfts_calibrate.array_correction import SCALARS
from fmfts_calibrate.command import CorrectionJob, make_corrected_model
from fmfts_calibrate.correct_verb import mounted_pad, starting_model
from fmfts_calibrate.dataset import standard_pad
from fmfts_calibrate.export import network_of
from fmfts_calibrate.field_table import DataError
from fmfts_calibrate.reshaped import Reshaped
from fmfts_lab.bench.few_presses import Pressed, Row, labelled_by_gauge, presses_of, table_of, trial
from fmfts_lab.bench.structure import Cell
from fmfts_lab.bench.weigh import Bench, facts_of

STIFF = Cell("stiff", modulus=1.5)
MODEL = ContactModel.load("default", standard_pad())


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench(STIFF, by_mm=6.0, seed=2)


@pytest.fixture(scope="module")
def table(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six presses, labelled by a gauge."""
    random = np.random.default_rng(3)
    presses = presses_of(STIFF, 6, random)
    path = tmp_path_factory.mktemp("presses") / "presses.csv"
    table_of(Pressed(bench, STIFF), presses, labelled_by_gauge(presses, random), path)
    return path


def corrected(bench: Bench, source: Path, target: Path, scale: float = 0.01) -> dict[str, object]:
    start = starting_model(bench.config, bench.baseline)
    mounted = mounted_pad(bench.config, bench.baseline, start, 2e-7)
    return make_corrected_model(source, target, CorrectionJob(mounted, start, 40.0, 0.5, scale), lambda _: None)


def changed(table: Path, to: Path, row: int | None, **cells: str | None) -> Path:
    """A copy with other cells in a press's row, or in all; None: without that column."""
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for number, one in enumerate(rows):
        if row is None or number == 2 * row + 1:  # a row of the untouched pad is before each press
            one.update({name: cell for name, cell in cells.items() if cell is not None})
    names = [name for name in rows[0] if cells.get(name, "") is not None]
    with to.open("w", newline="") as file:
        writer = csv.DictWriter(file, names, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    return to


def test_five_presses_correct_stiffer_and_thicker_pads() -> None:
    for cell in (STIFF, Cell("thick", modulus=0.7, thickness_mm=4.4)):
        row = Row(cell.name)
        trial(cell, 5, 4, Namespace(seconds=6.0, refine=False, without=()), None, row)
        facts = facts_of([row.found])
        assert row.refused == []
        assert facts["wrong"] == 0
        assert facts["force_off_median"] < 0.03, "0.3 and more before"
        assert facts["force_within_2_sd"] > 0.93
        assert facts["force_sd_median"] < 0.12


def test_scale_of_the_labels_widens_every_force(bench: Bench, table: Path, tmp_path: Path) -> None:
    tables = []
    for scale in (0.01, 0.1):
        report = corrected(bench, table, tmp_path / "own.onnx", scale)
        assert report["scale_sd"] == scale
        model = ContactModel.load(str(tmp_path / "own.onnx"), bench.config.pad())
        assert model.facts.response_error is not None
        tables.append(np.array(model.facts.response_error.force_error_n))
    assert (tables[1][-1] > tables[0][-1]).all()
    largest_n = model.facts.envelope.force_max_n
    assert tables[1][-1].min() > 0.07 * largest_n


def test_places_are_read_where_the_set_has_none(bench: Bench, table: Path, tmp_path: Path) -> None:
    labelled = corrected(bench, table, tmp_path / "own.onnx")
    for source in (
        changed(table, tmp_path / "without.csv", None, x_mm=None, y_mm=None),
        changed(table, tmp_path / "empty.csv", None, x_mm="", y_mm=""),
    ):
        read = corrected(bench, source, tmp_path / "own.onnx")
        assert read["stiffness"] == pytest.approx(labelled["stiffness"], rel=0.05)
        assert read["stiffness"] == pytest.approx(1.5, rel=0.07)


def test_wrong_label_is_found_and_named(bench: Bench, table: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"row 7 .* is its label wrong\?"):
        corrected(bench, changed(table, tmp_path / "wrong.csv", 2, force_n="5.0"), tmp_path / "own.onnx")


def test_four_presses_are_too_few(bench: Bench, table: Path, tmp_path: Path) -> None:
    few = tmp_path / "few.csv"
    few.write_text("\n".join(table.read_text().splitlines()[:9]) + "\n")
    with pytest.raises(DataError, match="4 presses; a correction needs 5"):
        corrected(bench, few, tmp_path / "own.onnx")


def test_correction_starts_from_the_weighed_stiffness(bench: Bench, table: Path, tmp_path: Path) -> None:
    weighed, _ = bench.in_the_middle()
    start = starting_model(bench.config, weighed)
    assert weighed.silicone is not None
    assert start.stiffness == weighed.silicone.stiffness
    mounted = mounted_pad(bench.config, weighed, start, 2e-7)
    job = CorrectionJob(mounted, start, 40.0, 0.5, 0.01)
    after = make_corrected_model(table, tmp_path / "own.onnx", job, lambda _: None)
    assert after["stiffness"] == pytest.approx(corrected(bench, table, tmp_path / "own.onnx")["stiffness"], rel=0.02)


def test_reshaped_model_answers_for_the_reshaped_response() -> None:
    theta = np.zeros(SCALARS + 2 + 40)
    theta[:5] = [-0.4, 0.1, -0.2, 0.15, 0.08]
    theta[SCALARS : SCALARS + 2] = [0.3, -0.2]
    reshaped = Reshaped.of(theta, 1.2)
    assert isinstance(MODEL.inference, NetworkInference)
    assert MODEL.response is not None
    network = network_of(np.frombuffer(MODEL.inference.network, np.float32))
    press = np.array([[1.0, 2.0, 1.0], [-4.0, 3.0, 0.6], [6.0, -5.0, 1.4]])
    poses = np.zeros((3, 6))
    poses[:, :5] = MODEL.rest_pose[:5] + MODEL.response.change(press)
    # The press that moves the reshaped pad like these move the model's, by factors of each number.
    moved = poses.copy()
    moved[:, :5] = MODEL.rest_pose[:5] + (poses - MODEL.rest_pose)[:, :5] * reshaped.kinds
    theirs = press.copy()
    theirs[:, :2] = (press[:, :2] + reshaped.off_mm) * reshaped.wider
    theirs[:, 2] *= reshaped.stiffness
    assert reshaped.response(MODEL.response).change(theirs) + MODEL.rest_pose[:5] == pytest.approx(moved[:, :5])
    off = network(poses) - press
    found = reshaped.network(network)(moved) - theirs
    assert found[:, :2] == pytest.approx(off[:, :2] * reshaped.wider, abs=1e-6)
    assert found[:, 2] == pytest.approx(off[:, 2] * reshaped.stiffness, abs=1e-6)
    facts = reshaped.facts(MODEL.facts)
    assert facts.envelope.force_max_n == pytest.approx(MODEL.facts.envelope.force_max_n * reshaped.stiffness)


def test_corrected_model_is_loaded_like_any_other(bench: Bench, table: Path, tmp_path: Path) -> None:
    report = corrected(bench, table, tmp_path / "own.onnx")
    model = load_contact_model(bench.config, str(tmp_path / "own.onnx"))
    assert model.hash == report["model"]
    assert model.facts.outputs == OUTPUT_ORDER
    assert [level["correction"] for level in report["corrections"]] == ["none", "force", "shape", "places"]  # type: ignore[attr-defined]
    assert report["chosen"] != "none"
