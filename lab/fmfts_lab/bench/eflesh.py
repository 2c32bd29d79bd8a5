"""What eFlesh's public recordings give: a table from contact to field, trained on one part, tested on another.

The recordings are in no repository of ours: `--recordings FOLDER` has eflesh_normal_1.csv, eflesh_normal_2.csv,
eflesh_shear_1.csv and eflesh_spatial_1.csv, or others of these names. What is missing is said and left out.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fmfts.pad import Array
from fmfts_calibrate.field_table import write
from fmfts_lab.eflesh import columns
from fmfts_skin.calibrate.field_evaluate import FieldEvaluation, evaluate_field
from fmfts_skin.calibrate.field_fit import make_response
from fmfts_skin.calibrate.field_set import FieldSet, Mask, read_field_set
from fmfts_skin.field_response import FieldResponse

BLOCK_MM, LEFT_OUT = 4.0, 0.25
# Another day, simulated: gain, contact height, moment and the deviation of each sensor's rest.
GAIN, HEIGHT_MM, MOMENT, REST_UT = 0.1, 0.3, -0.02, 60.0
BANDS_MM = ((0.0, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.1))


def run(options: Namespace) -> None:
    folder = options.recordings
    for title, names, part in (
        ("Normal force", ("normal_1", "normal_2"), _normal),
        ("Shear", ("shear_1",), _shear),
        ("Place", ("spatial_1",), _spatial),
    ):
        paths = [folder / f"eflesh_{name}.csv" for name in names]
        if absent := [path.name for path in paths if not path.exists()]:
            print(f"{title}: left out, for {folder} has no {', '.join(absent)}\n")
            continue
        print(f"## {title}\n")
        part(*paths)
        print()


def converted(path: Path, load: str = "force_n", boards: int = 0) -> FieldSet:
    with TemporaryDirectory() as folder:
        target = Path(folder) / path.name
        with target.open("w") as out:
            write(columns(path, load, boards), out)
        return read_field_set(target)


def _normal(first: Path, second: Path) -> None:
    one, two = converted(first), converted(second)
    print(LOAD_HEAD)
    for name, train, test in (("1, tested on 2", one, two), ("2, tested on 1", two, one)):
        _loads(f"trained on recording {name}", train, test)
    for name, data in (("1", one), ("2", two)):
        early = _cycle(data) < (_cycle(data).max() + 1) // 2
        _loads(f"recording {name}: first half, tested on the second", data.rows(early), data.rows(~early))
        left = _some(data)
        _loads(
            f"recording {name}: four rows of five, tested on the others", data.rows(~left | data.rest), data.rows(left)
        )


def _some(data: FieldSet) -> Mask:
    """(K,): one row in five at random, and all rests, which every row needs."""
    return (np.random.default_rng(3).random(len(data.rest)) < 0.2) | data.rest


def _shear(path: Path) -> None:
    print(LOAD_HEAD)
    for boards in (1, 2):
        data = converted(path, "shear_n", boards)
        left = _some(data)
        early = _cycle(data) < (_cycle(data).max() + 1) // 2
        which = "one board" if boards == 1 else "both boards"
        _loads(f"{which}: first half, tested on the second", data.rows(early), data.rows(~early))
        _loads(f"{which}: second half, tested on the first", data.rows(~early), data.rows(early))
        _loads(f"{which}: four rows of five, tested on the others", data.rows(~left | data.rest), data.rows(left))


LOAD_HEAD = (
    "| | rms N | mean N | after the first press, rms N | and with one factor known, rms N (factor) "
    "| within 2 deviations | beyond 5 |\n| --- | --- | --- | --- | --- | --- | --- |"
)


def _loads(name: str, train: FieldSet, test: FieldSet) -> None:
    evaluation = evaluate_field(make_response(train, "recording", _quiet), test, "recording")
    error, load = (evaluation.found - evaluation.contact)[:, 0], evaluation.contact[:, 0]
    off = np.abs(error / evaluation.deviation[:, 0])
    cycle = _cycle(test)[test.labelled]
    late = cycle > cycle.min()
    factor = float((load * evaluation.found[:, 0])[late].sum() / (evaluation.found[:, 0] ** 2)[late].sum())
    known = factor * evaluation.found[:, 0] - load
    print(
        f"| {name} | {_rms(error):.2f} | {error.mean():+.2f} | {_rms(error[late]):.2f} | {_rms(known[late]):.2f} "
        f"({factor:.3f}) | {np.mean(off <= 2.0):.1%} | {np.mean(off > 5.0):.1%} |"
    )


def _cycle(data: FieldSet) -> Array:
    """(K,): the number of rests before each row; a press lasts until the next rest."""
    begins = data.rest & ~np.concatenate([[False], data.rest[:-1]])
    cycle: Array = np.maximum(np.cumsum(begins) - 1, 0).astype(np.float64)
    return cycle


def _spatial(path: Path) -> None:
    data = converted(path)
    row = np.arange(len(data.rest)) / len(data.rest)
    depth = data.contact[:, 2]
    block = np.floor((data.contact[:, :2] + 100.0) / BLOCK_MM) @ np.array([1000.0, 1.0])
    random = np.random.default_rng(1)
    blocks = np.unique(block)
    out = np.isin(block, random.choice(blocks, round(LEFT_OUT * len(blocks)), replace=False))
    early = row < 0.6
    print(
        "| | presses | rms mm | median | p95 | "
        + " | ".join(f"rms {low:g}–{high:.0f} mm deep" for low, high in BANDS_MM)
        + " | x, y within 2 deviations | beyond 5 |\n"
        + "| --- " * 11
        + "|"
    )
    tables: dict[str, FieldResponse] = {}
    for name, train, test, other in (
        ("first 60 % of the time, tested on the rest", early, ~early, ""),
        ("the same, as recorded: nothing learnt of the test", early, ~early, "as recorded"),
        ("the same, only its rest known (as the presses tell it)", early, ~early, "rest"),
        ("the same, on another day (simulated)", early, ~early, "day"),
        ("last 60 %, tested on the first 40 %", row >= 0.4, row < 0.4, ""),
        ("the same, on another day (simulated)", row >= 0.4, row < 0.4, "day"),
        ("depths below 2 mm in the first 60 %, tested on all of the rest", early & (depth < 2.0), ~early, ""),
        ("depths of 2 to 3 mm, tested on all", early & (depth > 2.0) & (depth < 3.0), ~early, ""),
        ("left out blocks of 4 mm", early & ~out, ~early & out, ""),
    ):
        key = train.tobytes().hex()
        if key not in tables:
            tables[key] = make_response(data.rows(train), "recording", _quiet)
        _places(name, tables[key], data.rows(test), other)


def _places(name: str, response: FieldResponse, test: FieldSet, other: str) -> None:
    if other == "day":
        test = another_day(response, test)
    if other == "rest":
        test = from_its_rest(response, test)
    evaluation = evaluate_field(response, test, "recording", learn=other not in ("as recorded", "rest"))
    error = (evaluation.found - evaluation.contact)[:, :2]
    distance, off = np.hypot(error[:, 0], error[:, 1]), np.abs(error / evaluation.deviation[:, :2])
    bands = " | ".join(f"{_rms(distance[members]):.2f}" for members in _bands(evaluation))
    print(
        f"| {name} | {len(distance)} | {_rms(distance):.2f} | {np.median(distance):.2f} "
        f"| {np.quantile(distance, 0.95):.2f} | {bands} | {np.mean(off <= 2.0):.1%} | {np.mean(off > 5.0):.1%} |",
        flush=True,
    )


def from_its_rest(response: FieldResponse, test: FieldSet) -> FieldSet:
    """The test's fields, shifted to the table's field of the untouched pad, as a baseline does. This recording has no
    untouched rows, so the rest is estimated from its presses.
    """
    (learnt,) = evaluate_field(response, test, "recording").instances.values()
    return replace(test, field_ut=test.field_ut - (1.0 + learnt.moment) * learnt.rest_ut + response.reference_ut)


def another_day(response: FieldResponse, test: FieldSet) -> FieldSet:
    """The test's fields with another gain, moment and rest, and of a lower pad, as the table's slope has it."""
    rest = response.reference_ut
    lower = HEIGHT_MM * response.felt(test.contact).slope[:, :, 2]
    change = (1.0 + GAIN) * (test.field_ut - rest - lower)
    drawn = np.random.default_rng(2).normal(0.0, REST_UT, len(rest))
    return replace(test, field_ut=(1.0 + MOMENT) * (rest + drawn + change))


def _bands(evaluation: FieldEvaluation) -> Iterator[Mask]:
    depth = evaluation.contact[:, 2]
    return ((depth >= low) & (depth < high) for low, high in BANDS_MM)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def _quiet(line: str) -> None:
    """The table's own figures are not the benchmark's."""
