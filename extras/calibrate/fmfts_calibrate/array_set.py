"""Reads labelled presses of a pad with several magnets: the change of field of each one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fmfts import baseline as baselines
from fmfts.baseline import Baseline, BaselineError, Mounting
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.baseline.files import StateError, stored
from fmfts.common.names import field_columns
from fmfts.common.reading import digest_of
from fmfts.contact.contract import OUTPUT_ORDER
from fmfts.pad import Array, Pad
from fmfts_calibrate.dataset import LARGEST_RATIO, labels_of, require_consistent
from fmfts_calibrate.field_table import DataError, FieldTable, read
from fmfts_calibrate.labelled_poses import Say
from fmfts_calibrate.press_set import PressSet

# Deviations of a label: a stage's place, and a gauge's force, as a share.
PLACE_MM, FORCE_SHARE, FORCE_N = 0.05, 0.01, 0.005
# Deviation of the ambient field along each axis: since the last row of the untouched pad, and since the baseline.
AMBIENT_AFTER_REST_T, AMBIENT_T = 3e-7, 1e-5
OF_COLLECT = "baseline"  # the column of a table that `collect` wrote


@dataclass(frozen=True, slots=True)
class Changes(PressSet):
    """change_t (K, 3N): of the magnets' field, since rest, in sensor axes. ambient_t (K,): deviation of a remaining
    ambient field."""

    change_t: Array
    ambient_t: Array


@dataclass(frozen=True, slots=True)
class ArraySet(Changes):
    """Presses on one mounted pad with several magnets. baseline: its id."""

    pad: Pad
    mounting: ArrayMounting
    baseline: str


def read_array_set(path: Path, pad: Pad, pad_size_mm: float, baseline: Path | None, say: Say) -> ArraySet:
    """Read columns x_mm, y_mm, force_n (shear_x_n, shear_y_n) and b1x_ut …

    The fields are as recorded. In a table that `collect` wrote they are those of the magnets, by the baseline that its
    rows name. baseline: a file; None: the pad's own. Raises DataError, which names file, row and column.
    """
    recorded = baseline_of(baseline, pad)
    try:
        mounting = recorded.array_mounting(pad)
    except BaselineError as error:
        raise DataError(str(error)) from error
    table = of_this_baseline(path, read(path, len(pad.sensors)), recorded.id, say)
    found = changes_of(path, table, mounting, pad_size_mm)
    values = (found.press, found.press_deviation, found.line, found.digest, found.change_t, found.ambient_t)
    return ArraySet(*values, pad, mounting, recorded.id)


def changes_of(
    path: Path, table: FieldTable, mounting: ArrayMounting | Mounting, pad_size_mm: float, place_mm: float = PLACE_MM
) -> Changes:
    """The change of field by each press, since the row of the untouched pad before it. place_mm: deviation of a place;
    infinite: places are not known, and all have the label (0, 0)."""
    if np.isinf(place_mm):
        unknown = dict.fromkeys(OUTPUT_ORDER[:2], ["0"] * len(table.line))
        table = replace(table, others=table.others | unknown)
        press = labels_of(path, table, pad_size_mm)
    else:
        press = labels_of(path, table, pad_size_mm)
        require_consistent(path, table, press)
    press = np.concatenate([press, np.zeros((len(press), 5 - press.shape[1]))], axis=1)
    if OF_COLLECT in table.others:
        field_t, rest_t = table.field_t, mounting.rest_field_t
    else:
        field_t, rest_t = table.field_t / mounting.gain, mounting.rest_field_t + mounting.offset_t
    _require_fields(path, table, field_t, rest_t)
    untouched = (press[:, 2:] == 0.0).all(axis=1)
    change_t, ambient_t = np.empty((len(press), rest_t.size)), np.full(len(press), AMBIENT_T)
    for row in range(len(press)):
        if untouched[row]:
            rest_t, ambient_t[row:] = field_t[row], AMBIENT_AFTER_REST_T
        change_t[row] = (field_t[row] - rest_t).ravel()
    rows = np.flatnonzero(~untouched)
    if not len(rows):
        raise DataError(f"{path}: column force_n is zero in every row: there is no press to learn from")
    spread_n = _column(path, table, "force_sd_n")
    force_n = np.sqrt(np.square(FORCE_SHARE * press[:, 2]) + np.square(np.maximum(spread_n, FORCE_N)))
    deviation = np.column_stack([np.full((len(press), 2), place_mm), force_n])
    lines = tuple(table.line[row] for row in rows)
    return Changes(press[rows], deviation[rows], lines, digest_of(path), change_t[rows], ambient_t[rows])


def baseline_of(path: Path | None, pad: Pad) -> Baseline:
    """The baseline in a file, or the pad's own if None. DataError where it cannot be used, or rest is not in it."""
    try:
        found = stored(pad) if path is None else baselines.load(path, pad)
    except (BaselineError, StateError) as error:
        raise DataError(str(error)) from error
    if found is None or found.rest is None:
        which = f"pad '{pad.name}'" if path is None else str(path)
        raise DataError(
            f"{which}: there is no baseline with the pad at rest, which gives the places of its magnets: give the one "
            "that the presses were recorded with (--baseline FILE), or record it: fmfts-daemon baseline --rest"
        )
    return found


def of_this_baseline(path: Path, table: FieldTable, own: str, say: Say) -> FieldTable:
    """Excludes rows that `collect` wrote with another baseline, because their rest is not known."""
    if OF_COLLECT not in table.others:
        return table
    named = table.others[OF_COLLECT]
    rows = [row for row, name in enumerate(named) if name.strip() == own]
    others = sorted({name for name in named if name.strip() != own})
    if not rows:
        raise DataError(
            f"{path}: column {OF_COLLECT}: was collected with {', '.join(others)}, not with baseline {own}: give that "
            "file with --baseline (the state folder keeps the one before, too)"
        )
    if others:
        say(
            f"{path}: {len(named) - len(rows)} of {len(named)} rows are of baseline {', '.join(others)}, not of {own}: "
            "left out"
        )
    kept = {name: [cells[row] for row in rows] for name, cells in table.others.items()}
    return FieldTable(table.field_t[rows], table.bound_t[rows], kept, [table.line[row] for row in rows])


def _require_fields(path: Path, table: FieldTable, field_t: Array, rest_t: Array) -> None:
    names = field_columns(len(rest_t))
    absent = np.argwhere(~np.isfinite(field_t.reshape(len(field_t), -1)))
    if len(absent):
        row, column = absent[0]
        raise DataError(f"{path}: row {table.line[row]}, column {names[column]}: no number; leave the row out")
    ratios = np.linalg.norm(field_t, axis=(1, 2)) / np.linalg.norm(rest_t)
    wrong = np.flatnonzero((ratios > LARGEST_RATIO) | (ratios < 1.0 / LARGEST_RATIO))
    if len(wrong):
        row = wrong[0]
        raise DataError(
            f"{path}: row {table.line[row]}, columns {names[0]} … {names[-1]}: the field is {ratios[row]:.3g} times "
            f"that of the pad at rest, in {len(wrong)} of {len(ratios)} rows: are these columns in µT, raw, and of "
            "this pad and baseline?"
        )


def _column(path: Path, table: FieldTable, name: str) -> Array:
    """The numbers (K,) of a column; zeros if it is absent."""
    cells = table.others.get(name)
    if cells is None:
        return np.zeros(len(table.line))
    values = np.empty(len(cells))
    for row, cell in enumerate(cells):
        try:
            values[row] = float(cell) if cell.strip() else 0.0
        except ValueError:
            values[row] = np.nan
        if not 0.0 <= values[row] < np.inf:
            raise DataError(f"{path}: row {table.line[row]}, column {name}: {cell!r} is no deviation: zero or more")
    return values
