"""A table of presses from labelled presses of a pad with several magnets: its accuracy, and refusals."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmfts.baseline.baseline import encode, make_bare, make_rest
from fmfts.baseline.recording import Recording
from fmfts.contact.array_response import CHANGE, ArrayResponse
from fmfts.pad import Array, Pad, Tolerance
from fmfts.pose.magnets import field_of
from fmfts_calibrate.array_correction import LEVELS, Correction
from fmfts_calibrate.array_fit import fit_table
from fmfts_calibrate.array_set import ArraySet, read_array_set
from fmfts_calibrate.array_start import SHIPPED_MM, hash_of, starting_table
from fmfts_calibrate.field_table import DataError
from fmfts_lab.bench.several_world import BUILT, EXACT, NOISE_T, Press, World, world
from fmfts_lab.finite_elements.array_pad import array_config

PAD = array_config().pad()
START = starting_table(None, PAD)
FRAMES = 64  # that `collect` averages


def silent(_: str) -> None:
    pass


def other(factor: float, narrower: float = 0.0) -> ArrayResponse:
    """Silicone that needs `factor` times the force. narrower: how much less the magnets beside a finger move."""
    powers = factor ** -np.arange(1.0, START.coefficient.shape[2] + 1.0)
    coefficient = START.coefficient * powers[:, None]
    size = len(coefficient)
    along = START.first_mm + START.spacing_mm * (np.arange(size) - 1.0)
    x, y = np.meshgrid(along, along, indexing="ij")
    for magnet, (at_x, at_y) in enumerate(SHIPPED_MM.tolist()):
        away = np.hypot(x - at_x, y - at_y)
        share = 1.0 - narrower * away / 20.0
        own = slice(CHANGE * magnet, CHANGE * (magnet + 1))
        coefficient[..., own] = coefficient[..., own] * share[:, :, None, None]
    return replace(START, coefficient=coefficient, shear=START.shear / factor, scale_n=START.scale_n * factor)


def presses_of(one: World, press: Array, frames: int = FRAMES) -> ArraySet:
    """press (K, 5), as a stage labels them: to 0.05 mm and 1 %."""
    random, change = one.random, []
    for x, y, force, *shear in press.tolist():
        x, y = (float(each + random.normal(0.0, 0.05)) for each in (x, y))
        moved = one.pressed([Press(x, y, force * random.normal(1.0, 0.01), *shear)])
        field = one._field(one.magnets.changed(moved, one.frames), one.ambient_t)
        field = field + random.normal(0.0, NOISE_T / np.sqrt(frames), field.shape)
        change.append((one.mounting.magnet_field(field) - one.mounting.rest_field_t).ravel())
    deviation = np.column_stack([np.full((len(press), 2), 0.05), 0.01 * press[:, 2]])
    lines = tuple(range(2, len(press) + 2))
    return ArraySet(press, deviation, lines, "", np.array(change), np.full(len(press), 3e-7), PAD, one.mounting, "")


def grid(places: int = 3, forces: tuple[float, ...] = (0.6, 1.5), shear_n: float = 0.0) -> Array:
    along = np.linspace(-10.0, 10.0, places)
    each = [[x, y, force, 0.0, 0.0] for x in along for y in along for force in forces]
    if shear_n:
        each += [[x, y, 1.0, shear_n, 0.0] for x in along for y in along]
    return np.array(each)


def built(response: ArrayResponse, seed: int = 5, tolerance: Tolerance = BUILT) -> World:
    return replace(world(seed, tolerance), response=response)


def force_error(table: ArrayResponse, truth: ArrayResponse) -> float:
    """rms (N) of the force at which the table has the movement of 1 N, over the pad."""
    random = np.random.default_rng(1)
    off = []
    for x, y in random.uniform(-10.0, 10.0, (60, 2)).tolist():
        wanted, found = truth.pressed(x, y, 1.0), table.pressed(x, y, 1.0)
        off.append((wanted.change - found.change) @ found.slope[:, 2] / (found.slope[:, 2] @ found.slope[:, 2]))
    return float(np.sqrt(np.mean(np.square(off))))


def test_eighteen_presses_correct_the_table_of_stiffer_silicone() -> None:
    truth = other(1.25)
    made = fit_table(presses_of(built(truth), grid()), "set.csv", START, NOISE_T / 8.0, silent)
    assert force_error(START, truth) > 0.15
    # One label is known to 1 %, 18 to 0.3 %; the baseline contributes gains of 0.5 % and magnets' places to 0.1 mm.
    assert force_error(made.response, truth) < 0.02
    # Force and depth are separated by the curvature of the table with force: the factor alone is known to a tenth.
    assert made.force_factor == pytest.approx(1.25, rel=0.1)
    # The largest force of the table grows with the force that the silicone needs.
    assert made.response.scale_n == pytest.approx(START.scale_n * made.force_factor)


def test_smallest_correction_that_explains_left_out_presses_is_chosen() -> None:
    same = fit_table(presses_of(built(START, tolerance=EXACT), grid()), "set.csv", START, NOISE_T / 8.0, silent)
    assert same.chosen == "none"
    assert [level.name for level in same.levels] == ["none", *LEVELS]
    narrower = fit_table(presses_of(built(other(1.25, 0.6)), grid(4)), "set.csv", START, NOISE_T / 8.0, silent)
    assert narrower.chosen not in ("none", "force")
    left_out = {level.name: level.left_out for level in narrower.levels}
    assert left_out[narrower.chosen] < 0.5 * left_out["force"]


def test_shear_is_learned_where_the_set_has_it() -> None:
    truth = other(1.0)
    truth = replace(truth, shear=1.3 * truth.shear)
    made = fit_table(presses_of(built(truth), grid(shear_n=0.5)), "set.csv", START, NOISE_T / 8.0, silent)
    ratio = np.linalg.norm(made.response.shear) / np.linalg.norm(START.shear)
    assert ratio == pytest.approx(1.3, rel=0.05)  # shear of 0.5 N moves magnets by 20 µm, and the baseline's gains by 1


def test_table_states_its_error_if_corrections_do_not_suffice() -> None:
    """A pad whose movements scatter from press to press by 8 %: no smooth table explains that."""
    one = built(START)
    data = presses_of(one, grid(4))
    loose = replace(data, change_t=data.change_t * one.random.normal(1.0, 0.08, (len(data.press), 1)))
    made = fit_table(loose, "set.csv", START, NOISE_T / 8.0, silent)
    assert fit_table(data, "set.csv", START, NOISE_T / 8.0, silent).response.error < 0.01
    assert 0.04 < made.response.error < 0.16
    again = ArrayResponse.of(made.response.encoded(), "again")
    assert again.error == made.response.error


def test_empty_correction_keeps_the_table() -> None:
    correction = Correction.of(START, SHIPPED_MM)
    table = correction.table(correction.none, START.error)
    np.testing.assert_allclose(table.coefficient, START.coefficient, atol=1e-12)
    np.testing.assert_allclose(table.shear, START.shear, atol=1e-12)


def test_slopes_of_a_correction_are_those_of_differences() -> None:
    correction, random = Correction.of(START, SHIPPED_MM), np.random.default_rng(3)
    theta = 0.3 * correction.deviation * random.normal(size=len(correction.none))
    press, unmoved = grid(), np.zeros((4, 2))
    press[:, 3:] = random.normal(0.0, 0.1, (len(press), 2))
    of_map = correction.map_at(press[:, :2], unmoved)
    _, slope, _ = correction.presses(theta, press, unmoved, of_map)
    step = 1e-5
    for number in (*range(14), 20, len(theta) - 1):
        move = step * (np.arange(len(theta)) == number)
        more, less = (correction.presses(theta + sign * move, press, unmoved, of_map)[0] for sign in (1, -1))
        np.testing.assert_allclose((more - less) / (2 * step), slope[:, :, number], atol=1e-6)
    # A map is so smooth that a label's wrong place makes no difference: that slope excludes it.
    theta = theta * (np.arange(len(theta)) < 14)
    _, _, by_press = correction.presses(theta, press, unmoved, of_map)
    for column in range(3):
        move = step * (np.arange(5) == column)
        more, less = (
            correction.presses(theta, moved, unmoved, correction.map_at(moved[:, :2], unmoved))[0]
            for moved in (press + move, press - move)
        )
        np.testing.assert_allclose((more - less) / (2 * step), by_press[:, :, column], atol=1e-6)


def test_map_of_a_square_pad_has_the_square_s_mirror_images() -> None:
    correction, random = Correction.of(START, SHIPPED_MM), np.random.default_rng(4)
    theta = correction.deviation * random.normal(size=len(correction.none)) * (np.arange(len(correction.none)) >= 14)
    table = correction.table(theta, START.error)
    here, mirrored, turned = (
        table.pressed(x, y, 1.0).change.reshape(4, CHANGE) for x, y in ((3.0, 5.0), (-3.0, 5.0), (5.0, 3.0))
    )
    np.testing.assert_allclose(mirrored[[2, 3, 0, 1]], here * [-1.0, 1.0, 1.0, -1.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(turned[[0, 2, 1, 3]][:, [1, 0, 2, 4, 3]], here, atol=1e-9)
    assert np.abs(here - START.pressed(3.0, 5.0, 1.0).change.reshape(4, CHANGE)).max() > 1e-3


def larger(scale: float, order: tuple[int, ...] = (0, 1, 2, 3)) -> Pad:
    each = [PAD.magnets[number] for number in order]
    moved = [replace(one, rest_position_m=one.rest_position_m * [scale, scale, 1.0]) for one in each]
    return replace(
        PAD, rest_position_m=moved[0].rest_position_m, rest_axis=moved[0].rest_axis, other_magnets=tuple(moved[1:])
    )


def test_shipped_table_is_scaled_and_reordered_for_a_larger_pad() -> None:
    pad = larger(1.5, (3, 1, 0, 2))
    table = starting_table(None, pad)
    at, here = table.pressed(4.5, 3.0, 2.25), START.pressed(3.0, 2.0, 1.0)
    own = here.change.reshape(4, CHANGE)[[3, 1, 0, 2]] * [1.5, 1.5, 1.5, 1.0, 1.0]
    np.testing.assert_allclose(at.change.reshape(4, CHANGE), own, atol=1e-12)
    assert table.geometry_hash == hash_of(pad) != hash_of(PAD)


@pytest.mark.parametrize(
    ("pad", "sentence"),
    [
        (larger(2.5), r"2.5 times as far apart .* from 0.5 to 2"),
        (replace(PAD, other_magnets=PAD.other_magnets[:2]), r"has 3 magnets, .* of four: give a table .* --start"),
        (
            replace(PAD, rest_position_m=PAD.rest_position_m + np.array([5e-3, 0.0, 0.0])),
            r"not near the corners of a square .* --start",
        ),
    ],
)
def test_pad_far_from_any_table_is_refused_with_advice(pad: Pad, sentence: str) -> None:
    with pytest.raises(DataError, match=sentence):
        starting_table(None, pad)


@pytest.fixture(scope="module")
def pressed() -> ArraySet:
    return presses_of(built(other(1.25)), grid())


def mislabelled(data: ArraySet) -> ArraySet:
    press = data.press.copy()
    press[4, 0] = -4.0
    return replace(data, press=press)


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (lambda data: data.only(np.arange(12)), r"12 presses at 6 places; .* needs 18 presses at 9 places"),
        (
            lambda data: replace(data, press=data.press * [1, 1, 0, 1, 1] + [0, 0, 1, 0, 0]),
            r"all presses have one force",
        ),
        (mislabelled, r"row 6 \(.*, 0.6 N: its field is \d+ deviations .* is its label wrong\?"),
        (
            lambda data: replace(data, change_t=np.random.default_rng(2).permutation(data.change_t)),
            r"no correction of the table explains these fields: .* is it this pad, and its baseline",
        ),
    ],
)
def test_presses_that_make_no_table_are_refused(
    pressed: ArraySet, edit: Callable[[ArraySet], ArraySet], sentence: str
) -> None:
    with pytest.raises(DataError, match=sentence):
        fit_table(edit(pressed), "set.csv", START, NOISE_T / 8.0, silent)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, list[dict[str, str]]]:
    """A baseline's file and id, and rows of raw fields: rest, then presses."""
    folder, one = tmp_path_factory.mktemp("set"), built(other(1.25))

    def recorded(field: Array) -> Recording:
        mean = one.gain * field
        return Recording(mean, np.full(mean.shape, NOISE_T), np.full(8, 660), 0, 25.0, 3.0)

    bare = one.sensors.to_sensor(np.tile(one.ambient_t, (8, 1)))
    before = make_bare(PAD, BUILT, recorded(bare))
    baseline = make_rest(PAD, BUILT, recorded(bare + field_of(one.magnets, one.sensors)), before)[0]
    path = folder / "baseline"
    path.write_bytes(encode(baseline))
    rows = []
    for x, y, force, *_ in [[0.0] * 5, *grid().tolist()]:
        moved = one.pressed([Press(x, y, force)]) if force else np.zeros(20)
        field_ut = one._field(one.magnets.changed(moved, one.frames), one.ambient_t).ravel() * 1e6
        cells = {f"b{number // 3 + 1}{'xyz'[number % 3]}_ut": f"{value:.4f}" for number, value in enumerate(field_ut)}
        rows.append({"x_mm": str(x), "y_mm": str(y), "force_n": str(force)} | cells)
    return path, baseline.id, rows


def read(folder: Path, baseline: Path | None, rows: list[dict[str, str]], said: list[str] | None = None) -> ArraySet:
    path = folder / "set.csv"
    with path.open("w", newline="") as out:
        writer = csv.DictWriter(out, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return read_array_set(path, PAD, 40.0, baseline, silent if said is None else said.append)


def test_raw_fields_count_from_row_of_untouched_pad_before_them(
    files: tuple[Path, str, list[dict[str, str]]], tmp_path: Path
) -> None:
    baseline, _, rows = files
    data = read(tmp_path, baseline, rows)
    turned = [dict(row) for row in rows]
    for row in turned:
        row["b3y_ut"] = f"{float(row['b3y_ut']) + 20.0:.4f}"  # an ambient field that has changed since the baseline
    again = read(tmp_path, baseline, turned)
    assert len(data.press) == 18
    np.testing.assert_allclose(again.change_t, data.change_t, atol=1e-9)
    without_rest = read(tmp_path, baseline, turned[1:])
    assert np.abs(without_rest.change_t - data.change_t).max() > 1e-5
    assert without_rest.ambient_t[0] > again.ambient_t[0]


def edited(row: int, **cells: str) -> Callable[[list[dict[str, str]]], list[dict[str, str]]]:
    return lambda rows: [one | cells if number == row else one for number, one in enumerate(rows)]


@pytest.mark.parametrize(
    ("edit", "sentence"),
    [
        (edited(2, b1x_ut=""), r"row 4, column b1x_ut: no number"),
        (edited(2, force_n="-1"), r"row 4, column force_n: -1 N: a press is positive"),
        (
            lambda rows: [
                {name: f"{float(cell) / 10.0}" if name[0] == "b" else cell for name, cell in row.items()}
                for row in rows
            ],
            r"the field is 0\.\d+ times that of the pad at rest, in 19 of 19 rows: are these columns in µT",
        ),
        (
            lambda rows: [row | {"baseline": "0123456789ab"} for row in rows],
            r"column baseline: was collected with 0123456789ab, not with baseline \w+: give that file with --baseline",
        ),
        (lambda rows: [row | {"force_sd_n": "x"} for row in rows], r"row 2, column force_sd_n: 'x' is no deviation"),
        (lambda rows: rows[:1], r"force_n is zero in every row"),
    ],
)
def test_fault_of_a_set_is_named(
    files: tuple[Path, str, list[dict[str, str]]],
    tmp_path: Path,
    edit: Callable[[list[dict[str, str]]], list[dict[str, str]]],
    sentence: str,
) -> None:
    baseline, _, rows = files
    with pytest.raises(DataError, match=sentence):
        read(tmp_path, baseline, edit(rows))


def test_rows_of_another_baseline_are_left_out_and_reported(
    files: tuple[Path, str, list[dict[str, str]]], tmp_path: Path
) -> None:
    baseline, own, rows = files
    said: list[str] = []
    mixed = [row | {"baseline": own if number < 10 else "other"} for number, row in enumerate(rows)]
    assert len(read(tmp_path, baseline, mixed, said).press) == 9
    assert "9 of 19 rows are of baseline other" in said[0]


def test_set_without_baseline_asks_to_record_one(
    files: tuple[Path, str, list[dict[str, str]]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with pytest.raises(DataError, match=r"no baseline with the pad at rest.*--baseline FILE.*baseline --rest"):
        read(tmp_path, None, files[2])
