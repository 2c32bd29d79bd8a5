"""Pads whose magnets are unknown: from labelled fields to a table, and from a field to a contact."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fmfts.cli.main import main
from fmfts_calibrate.field_table import DataError
from fmfts_skin.calibrate.field_evaluate import FieldEvaluation, evaluate_field
from fmfts_skin.calibrate.field_fit import make_response
from fmfts_skin.calibrate.field_instance import REST_UT, explained
from fmfts_skin.calibrate.field_set import FieldSet, read_field_set
from fmfts_skin.field_contact import ContactFinder
from fmfts_skin.field_response import Axis, FieldResponse, FieldResponseError, Instance
from skin.skin_pad import DEEPEST_MM, REACH_MM, presses, skin_field, skin_set, write_skin

NOISE_UT = 5.0


def quiet(line: str) -> None:
    """Nobody reads it."""


def noisy(press: np.ndarray, seed: int) -> np.ndarray:
    return skin_field(press) + np.random.default_rng(seed).normal(0.0, NOISE_UT, (len(press), 15))


@cache
def table() -> FieldResponse:
    press = presses(1500, 1)
    return make_response(skin_set(press, noisy(press, 2)), "skin", quiet)


def replace_name(axis: Axis, name: str) -> Axis:
    return Axis(name, axis.first, axis.spacing, axis.cells)


def place_rms_mm(evaluation: FieldEvaluation) -> float:
    return float(np.sqrt(((evaluation.found - evaluation.contact)[:, :2] ** 2).sum(axis=1).mean()))


def force_set(count: int, seed: int, gain: float = 0.0) -> FieldSet:
    """Presses at one place, by force, with rests between: the newton makes 0.1 mm."""
    random = np.random.default_rng(seed)
    force = random.uniform(0.0, 20.0, count)
    rest = np.arange(count) % 50 < 5
    force[rest] = 0.0
    press = np.column_stack([np.full((count, 2), 2.0), 0.1 * force])
    none = skin_field(np.array([[0.0, 0.0, 0.0]]))
    field = none + (1.0 + gain) * (skin_field(press) - none) + random.normal(0.0, NOISE_UT, (count, 15))
    return replace(skin_set(force[:, None], field, ("force_n",)), rest=rest)


def test_contacts_are_found_with_the_deviation_that_is_stated() -> None:
    press = presses(400, 3)
    press[:, :2] *= 0.9
    found = ContactFinder(table(), moment_share=0.0).find(noisy(press, 4) - table().reference_ut)
    off = (found.contact - press) / found.deviation
    # The depth's deviation also includes the effect of another day's contact height; without it the errors are noise
    # alone.
    assert np.mean(np.abs(off[:, :2]) <= 2.0) > 0.93
    assert np.sqrt(np.mean(off[:, :2] ** 2)) > 0.7, "the deviation is no larger than it must be"
    assert not (np.abs(off) > 5.0).any()
    assert np.sqrt(np.mean((found.contact - press)[:, :2] ** 2)) < 0.15


def test_deviation_covers_a_moment_that_varies_between_frames() -> None:
    press = presses(400, 33)
    press[:, :2] *= 0.9
    wavering = 1.0 + np.random.default_rng(34).normal(0.0, table().moment_share, (400, 1))
    change = wavering * noisy(press, 35) - table().reference_ut
    considered, ignored = ContactFinder(table()).find(change), ContactFinder(table(), moment_share=0.0).find(change)
    within = [np.mean(np.abs((one.contact - press) / one.deviation)[:, :2] <= 2.0) for one in (considered, ignored)]
    assert within[0] > 0.93
    assert within[1] < 0.8


def test_slope_is_the_derivative_of_the_change() -> None:
    press, step = presses(50, 5), 1e-5
    slope = table().felt(press).slope
    for axis in range(3):
        moved = step * np.eye(3)[axis]
        difference = (table().felt(press + moved).change - table().felt(press - moved).change) / (2.0 * step)
        np.testing.assert_allclose(slope[:, :, axis], difference, atol=1e-4 * np.abs(slope).max())


def test_change_goes_on_along_its_tangent_beyond_the_table() -> None:
    last = table().axes[-1].last
    at = np.array([[1.0, 2.0, last], [1.0, 2.0, last + 0.5]])
    felt = table().felt(at)
    np.testing.assert_allclose(felt.change[1], felt.change[0] + 0.5 * felt.slope[0, :, 2])


def test_file_holds_the_table_to_the_last_bit() -> None:
    read = FieldResponse.of(table().encoded(), "skin.response")
    press = presses(20, 6)
    np.testing.assert_array_equal(read.felt(press).change, table().felt(press).change)
    np.testing.assert_array_equal(read.covariance, table().covariance)
    assert read.encoded() == table().encoded()


def test_damaged_files_are_refused() -> None:
    content = table().encoded()
    for broken in (content[:-1], content[:100], b"", content.replace(b"response 1", b"response 9")):
        with pytest.raises(FieldResponseError, match=r"skin\.response: is no field response"):
            FieldResponse.of(broken, "skin.response")
    infinite = replace(table(), reference_ut=np.full(15, np.inf))
    with pytest.raises(FieldResponseError, match="NaN"):
        FieldResponse.of(infinite.encoded(), "skin.response")
    no_load = replace(table(), axes=table().axes[:2])
    with pytest.raises(FieldResponseError, match="one load"):
        FieldResponse.of(no_load.encoded(), "skin.response")


def test_evaluate_learns_another_day_from_its_fields() -> None:
    """Another rest, warmer magnets and another gain: without labels nearly all of the error goes."""
    press = presses(600, 7)
    reference = table().reference_ut
    changed = 1.1 * (noisy(press, 8) - reference) + reference
    changed = 0.99 * changed + np.random.default_rng(9).normal(0.0, 30.0, 15)
    data = skin_set(press, changed)
    learnt, recorded = (evaluate_field(table(), data, "test", learn) for learn in (True, False))
    same_day = evaluate_field(table(), skin_set(press, noisy(press, 8)), "test")
    assert place_rms_mm(recorded) > 2.0 * place_rms_mm(learnt)
    assert place_rms_mm(learnt) < 1.2 * place_rms_mm(same_day)
    instance = learnt.instances["skin"]
    assert instance.gain == pytest.approx(0.1, abs=0.005)
    assert instance.moment == pytest.approx(-0.01, abs=0.002)


def test_softer_pad_gives_no_gain_when_load_is_force() -> None:
    press = presses(300, 22)
    by_force = replace(table(), axes=(*table().axes[:2], replace_name(table().axes[2], "force_n")))
    changed = 1.1 * (noisy(press, 23) - table().reference_ut)
    data = skin_set(press, changed + table().reference_ut, ("x_mm", "y_mm", "force_n"))
    assert evaluate_field(by_force, data, "test").instances["skin"].gain == pytest.approx(0.0, abs=1e-6)


def test_learning_a_day_reads_no_label() -> None:
    press = presses(300, 10)
    field = noisy(press, 11)
    told = explained(table(), field, Instance(table().reference_ut), REST_UT)
    evaluation = evaluate_field(table(), skin_set(press[::-1].copy(), field), "test")
    np.testing.assert_array_equal(evaluation.instances["skin"].rest_ut, told.rest_ut)


def test_drifting_moment_is_not_reported_as_contact() -> None:
    """The magnets warm while the set is gathered, row by row of places; the table is as good as without."""
    press = presses(1500, 12)
    press = press[np.argsort(np.round(press[:, 0]) + 100.0 * (np.arange(1500) // 300))]
    warming = 1.0 - 0.015 * np.linspace(-0.5, 0.5, 1500)[:, None]
    said: list[str] = []
    drifted = make_response(skin_set(press, warming * noisy(press, 13)), "skin", said.append)
    told = next(line for line in said if "the moment drifted by" in line)
    assert float(told.split("drifted by ")[1].split("%")[0]) == pytest.approx(1.5, abs=0.3)
    test = presses(300, 14)
    test[:, :2] *= 0.9
    data = skin_set(test, noisy(test, 15))
    assert place_rms_mm(evaluate_field(drifted, data, "test")) < 1.2 * place_rms_mm(
        evaluate_field(table(), data, "test")
    )


def test_rest_field_is_found_from_presses() -> None:
    """Of depths between 1.5 and 3 mm, where the field differs from the rest's by a millitesla."""
    press = presses(1500, 24)
    press[:, 2] = 1.5 + press[:, 2] / 2.0
    response = make_response(skin_set(press, noisy(press, 25)), "skin", quiet)
    rest = skin_field(np.zeros((1, 3)))[0]
    mean = skin_field(press).mean(axis=0)
    assert not response.rests
    assert np.abs(mean - rest).max() > 300.0
    assert np.abs(response.reference_ut - rest).max() < 0.1 * np.abs(mean - rest).max()
    # So it also finds lighter presses than any in its calibration.
    light = presses(300, 26)
    light[:, :2] *= 0.9
    light[:, 2] = 0.8
    evaluation = evaluate_field(response, skin_set(light, noisy(light, 27)), "test")
    assert place_rms_mm(evaluation) < 0.6


def test_single_place_set_needs_rest_rows() -> None:
    data = force_set(400, 28)
    with pytest.raises(DataError, match="no rows of rest"):
        make_response(replace(data, rest=np.zeros(400, dtype=np.bool_)), "skin", quiet)


def test_forces_count_from_the_newest_rest_and_keep_their_gain() -> None:
    response = make_response(force_set(600, 16), "skin", quiet)
    assert response.rests
    np.testing.assert_allclose(response.felt(np.zeros((1, 1))).change, 0.0, atol=2.0)
    data = force_set(400, 17, gain=0.03)
    shifted = replace(data, field_ut=data.field_ut + 40.0)
    evaluation = evaluate_field(response, shifted, "test")
    error = (evaluation.found - evaluation.contact)[:, 0]
    # 3 % more change is read as 3 % more force: nothing in the fields contradicts it. The deviation covers it.
    slope = (error * evaluation.contact[:, 0]).sum() / (evaluation.contact[:, 0] ** 2).sum()
    assert slope == pytest.approx(0.03, abs=0.01)
    assert np.mean(np.abs(error / evaluation.deviation[:, 0]) <= 2.0) > 0.93


def test_each_row_uses_the_preceding_rest() -> None:
    data = skin_set(np.zeros((7, 3)), np.arange(7.0)[:, None] * np.ones(15))
    data = replace(data, rest=np.array([0, 1, 1, 0, 0, 1, 0], dtype=np.bool_))
    assert data.rest_ut()[:, 0].tolist() == [1.5, 1.5, 1.5, 1.5, 1.5, 5.0, 5.0]
    without = replace(data, rest=np.zeros(7, dtype=np.bool_))
    assert np.isnan(without.rest_ut()).all()


def test_set_comes_back_from_its_file(tmp_path: Path) -> None:
    data = force_set(60, 18)
    read = read_field_set(write_skin(tmp_path / "skin.csv", data))
    assert read.axes == ("force_n",)
    np.testing.assert_array_equal(read.contact, data.contact)
    np.testing.assert_allclose(read.field_ut, data.field_ut, rtol=1e-12)
    np.testing.assert_array_equal(read.rest, data.rest)
    assert read.recordings == ("skin",)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x_mm,depth_mm,FIELDS\n", "x_mm alone"),
        ("x_mm,y_mm,FIELDS\n", "no load"),
        ("force_n,depth_mm,FIELDS\n", "depth_mm and force_n"),
        ("depth_mm,b1x_ut,b1y_ut,b1z_ut\n1,2,3,4\n", "at least 2 sensors"),
        ("depth_mm,rest,FIELDS\n1,2,VALUES\n", "row 2, column rest: '2'"),
        ("depth_mm,FIELDS\nhigh,VALUES\n", "row 2, column depth_mm: 'high'"),
        ("depth_mm,FIELDS\n1,1,2,3,4,5,\n", "row 2: a field is missing"),
    ],
)
def test_wrong_sets_are_refused_with_row_and_column(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "wrong.csv"
    text = text.replace("FIELDS", "b1x_ut,b1y_ut,b1z_ut,b2x_ut,b2y_ut,b2z_ut").replace("VALUES", "1,2,3,4,5,6")
    path.write_text(text if text.count("\n") > 1 else text + ",".join(["1"] * (text.count(",") + 1)) + "\n")
    with pytest.raises(DataError, match=said):
        read_field_set(path)


def test_verbs_make_a_table_and_evaluate_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    train = write_skin(tmp_path / "train.csv", force_set(400, 19))
    test = write_skin(tmp_path / "test.csv", force_set(200, 20))
    model = tmp_path / "skin.response"
    assert main(["calibrate", str(train), "-o", str(model)]) == 0
    assert model.with_suffix(".json").exists()
    assert main(["evaluate", str(test), "--model", str(model)]) == 0
    said = capsys.readouterr().out
    assert "force_within_2" in said
    assert "recording skin" in said
    press = presses(50, 21)
    other = write_skin(tmp_path / "other.csv", skin_set(press, skin_field(press)))
    assert main(["evaluate", str(other), "--model", str(model)]) == 65
    assert "the model is of force_n and 5 sensors" in capsys.readouterr().err
    assert main(["calibrate", str(other), "-o", str(model)]) == 65, "too few rows"


def test_evaluate_reports_the_learned_day_or_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "skin.response"
    model.write_bytes(table().encoded())
    press = presses(200, 29)
    test = write_skin(tmp_path / "test.csv", skin_set(press, 0.98 * noisy(press, 30)))
    assert main(["evaluate", str(test), "--model", str(model)]) == 0
    told = re.search(r"recording skin: moment (\S+)%", capsys.readouterr().out)
    assert told
    assert float(told.group(1)) == pytest.approx(-2.0, abs=0.2)
    assert main(["evaluate", str(test), "--model", str(model), "--as-recorded"]) == 0
    assert "recording skin: moment +0.00%" in capsys.readouterr().out


def test_table_that_counts_from_rests_asks_for_them() -> None:
    response = make_response(force_set(400, 31), "skin", quiet)
    data = force_set(200, 32)
    with pytest.raises(DataError, match="without rows of rest"):
        evaluate_field(response, replace(data, rest=np.zeros(200, dtype=np.bool_)), "test")


def test_finder_searches_the_whole_pad() -> None:
    corners = np.array([[x, y, DEEPEST_MM] for x in (-REACH_MM, REACH_MM) for y in (-REACH_MM, REACH_MM)]) * 0.9
    found = ContactFinder(table(), moment_share=0.0).find(skin_field(corners) - table().reference_ut)
    np.testing.assert_allclose(found.contact, corners, atol=0.3)
