"""Reads calibration sets, CSV files of labelled fields of one pad, and checks them for errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fmfts.baseline import Mounting
from fmfts.common.reading import digest_of
from fmfts.config import PadConfig, SimulatedSource
from fmfts.contact.contract import OUTPUT_ORDER, SHEAR_OUTPUT_ORDER
from fmfts.pad import Array, Pad
from fmfts.pose import solve
from fmfts_calibrate.field_table import DataError, FieldTable, mounting_of, read
from fmfts_calibrate.field_units import drawn_field, other_unit, question, strengths, stronger

PAD_SIZE_MM = 40.0
LARGEST_FORCE_N = 50.0
# With fewer, the standard pad's model is wrong, and left-out presses do not show it.
FEWEST_PRESSES, FEWEST_PLACES = 150, 8
FEWEST_VALUES = 6  # the paper's unknowns; the solver itself refuses too few values for its own
# Largest ratio between a measured field and the drawing's: remanence and place of the magnet cause smaller ones.
LARGEST_RATIO = 3.0
# A wrong unit shows in the components that are strong at rest: a press changes them by half, a unit by ten or more.
STRONG_SHARE, LEAST_UNIT_RATIO = 0.2, 8.0
# Largest difference of two fields with the same labels, from noise and from the stage's repeatability.
REPEATABLE_UT, REPEATABLE_SHARE = 5.0, 0.05
# Less shear than this share of the force, or of a tenth of the largest force, counts as none: a gauge with three axes
# never reads exactly zero.
SLIGHT_SHEAR = 0.02


def standard_pad(remanence_t: float = 1.23) -> Pad:
    """The pad that ships: the defaults of `[pad.geometry]` and `[pad.magnet]`."""
    pad = PadConfig(name="standard", source=SimulatedSource()).pad()
    return replace(pad, magnet=pad.magnet.with_remanence(remanence_t))


@dataclass(frozen=True, slots=True)
class CalibrationSet:
    """The presses of a file, and their fields.

    press (K, 3 or 5): x and y in mm, force in N, and shear x and y in N if known. field_t (K, N, 3): at the pad's
    sensors, in their axes; NaN where a value is missing or clipped. line (K,): its line in the file. digest: SHA-256 of
    the file. rest_field_t (N, 3): mean of the file's unloaded rows; None where it has none. mounting: from the
    baseline, if one was given. bound_t (K, N, 3): where a value was clipped the end of the range, with its sign; else
    NaN. None: nothing was clipped.
    """

    pad: Pad
    press: Array
    field_t: Array
    line: tuple[int, ...]
    digest: str
    rest_field_t: Array | None
    mounting: Mounting | None = None
    bound_t: Array | None = None

    @property
    def x_m(self) -> Array:
        return self.press[:, 0] * 1e-3

    @property
    def y_m(self) -> Array:
        return self.press[:, 1] * 1e-3

    @property
    def force_n(self) -> Array:
        return self.press[:, 2]


def read_calibration_set(
    path: Path, pad: Pad | None = None, pad_size_mm: float = PAD_SIZE_MM, baseline: Path | None = None
) -> CalibrationSet:
    """Read columns x_mm, y_mm, force_n (shear_x_n, shear_y_n) and b1x_ut … of `pad` (None: the standard pad).

    baseline: a file whose gains and ambient field are removed; None: the fields have none. Raises DataError, which
    names file, row and column of a wrong value: see docs/calibration.md.
    """
    calibration = read_labelled(path, pad, pad_size_mm, baseline)
    _require_enough(path, calibration.press)
    return calibration


def read_labelled(
    path: Path, pad: Pad | None = None, pad_size_mm: float = PAD_SIZE_MM, baseline: Path | None = None
) -> CalibrationSet:
    """Like `read_calibration_set`, for a test set, which may have as few as one press."""
    pad = pad or standard_pad()
    table = read(path, len(pad.sensors))
    press = labels_of(path, table, pad_size_mm)
    _require_fields(path, table, pad)
    unloaded = (press[:, 2:] == 0.0).all(axis=1)
    require_consistent(path, table, press)
    mounting = None if baseline is None else mounting_of(baseline, pad)
    field, bound = (
        some if mounting is None else np.array([mounting.magnet_field(one) for one in some])
        for some in (table.field_t, table.bound_t)
    )
    loaded = np.flatnonzero(~unloaded)
    if not len(loaded):
        raise DataError(f"{path}: column force_n is zero in every row: there is no press to learn from")
    return CalibrationSet(
        pad=pad,
        press=press[loaded],
        field_t=field[loaded],
        line=tuple(table.line[row] for row in loaded),
        digest=digest_of(path),
        rest_field_t=mean_of_known(field[unloaded]) if unloaded.any() else None,
        mounting=mounting,
        bound_t=bound[loaded],
    )


def mean_of_known(field: Array) -> Array:
    """(N, 3) mean over the rows (K, N, 3) that have a value; NaN if none has."""
    known = np.isfinite(field)
    with np.errstate(invalid="ignore"):
        mean: Array = np.where(known, field, 0.0).sum(axis=0) / known.sum(axis=0)
    return mean


def rest_field(calibration: CalibrationSet) -> Array:
    """(N, 3) field of the unloaded pad: measured, else the drawing's with the remanence estimated from the presses.

    NaN at axes that the chips do not have: those without a value in any row.
    """
    if calibration.rest_field_t is not None:
        return calibration.rest_field_t
    pad = calibration.pad
    drawn = drawn_field(pad)
    estimates = [solve(field, pad).remanence_t for field in calibration.field_t[::8]]
    measured = drawn * float(np.nanmedian(estimates) / solve(drawn, pad).remanence_t)
    has_axis = np.isfinite(calibration.field_t).any(axis=0)
    return np.where(has_axis, measured, np.nan)


def labels_of(path: Path, table: FieldTable, pad_size_mm: float) -> Array:
    """(K, 3 or 5) place, force, and shear if a column tells it. DataError for a label that is missing or impossible."""
    shear = [name for name in SHEAR_OUTPUT_ORDER[3:] if name in table.others]
    labels = SHEAR_OUTPUT_ORDER if shear else OUTPUT_ORDER
    missing = [name for name in labels if name not in table.others]
    if missing:
        raise DataError(f"{path}: row 1 has no column {', '.join(missing)}: each row needs its place and force")
    columns = [
        [_label(path, line, name, cell, pad_size_mm) for line, cell in zip(table.line, table.others[name], strict=True)]
        for name in labels
    ]
    press = np.array(columns).T
    shear_n, force_n = np.hypot.reduce(press[:, 3:], axis=1), press[:, 2]
    press[shear_n <= SLIGHT_SHEAR * np.maximum(force_n, force_n.max() / 10.0), 3:] = 0.0
    farthest_mm = np.abs(press[:, :2]).max()
    if 0.0 < farthest_mm <= pad_size_mm / 2000.0:
        raise DataError(
            f"{path}: columns x_mm, y_mm: no place is farther than {farthest_mm:g} mm from the centre: "
            "are they in metres?"
        )
    return press


def _label(path: Path, line: int, name: str, cell: str, pad_size_mm: float) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    where = f"{path}: row {line}, column {name}: "
    if not np.isfinite(value):
        raise DataError(f"{where}{cell!r} is not a number")
    if name.endswith("_mm") and abs(value) > pad_size_mm / 2.0:
        raise DataError(
            f"{where}{cell} mm is outside the pad, which ends at ±{pad_size_mm / 2.0:g} mm: is the origin at its "
            "centre, are these millimetres? (--pad-size-mm for another pad)"
        )
    if name.endswith("_n") and abs(value) > LARGEST_FORCE_N:
        raise DataError(f"{where}{cell} N is more than a soft pad bears: is it in grams or millinewtons?")
    if name == "force_n" and value < 0.0:
        raise DataError(f"{where}{cell} N: a press is positive; is the gauge's sign turned, or its zero off?")
    return value


def _require_fields(path: Path, table: FieldTable, pad: Pad) -> None:
    known = np.isfinite(table.field_t).sum(axis=(1, 2))
    few = np.flatnonzero(known < FEWEST_VALUES)
    if len(few):
        raise DataError(
            f"{path}: row {table.line[few[0]]}: {known[few[0]]} of its values are known; a pose needs {FEWEST_VALUES}"
        )
    ratios = strengths(table, pad)
    wrong = np.flatnonzero((ratios > LARGEST_RATIO) | (ratios < 1.0 / LARGEST_RATIO))
    if len(wrong):
        row, ratio = wrong[0], float(ratios[wrong[0]])
        raise DataError(
            f"{path}: row {table.line[row]}, {stronger(pad, ratio)} in {len(wrong)} of {len(ratios)} rows; "
            + question(other_unit(ratio))
        )
    _require_one_unit(path, table.field_t / ratios[:, None, None], drawn_field(pad))


def _require_one_unit(path: Path, field_t: Array, drawn_t: Array) -> None:
    """Checks that all columns have one unit. field_t (K, N, 3): scaled to the strength of the drawing's field."""
    strong = np.abs(drawn_t) > STRONG_SHARE * np.abs(drawn_t).max()
    strong &= np.isfinite(field_t).any(axis=0)
    size = np.where(np.isfinite(field_t).any(axis=0), np.abs(field_t), 0.0)
    share = np.nanmedian(size, axis=0) / np.where(strong, np.abs(drawn_t), 1.0)
    off = np.argwhere(strong & ((share > LEAST_UNIT_RATIO) | (share < 1.0 / LEAST_UNIT_RATIO)))
    if len(off):
        sensor, axis = off[0]
        raise DataError(
            f"{path}: column b{sensor + 1}{'xyz'[axis]}_ut: in most rows {share[sensor, axis]:.2g} times as much as "
            "the other columns suggest: is it in another unit, or is that axis of the sensor broken?"
        )


def require_consistent(path: Path, table: FieldTable, press: Array) -> None:
    """DataError for a field with two different labels, or a label with two different fields."""
    by_field: dict[bytes, int] = {}
    by_press: dict[bytes, int] = {}
    for row in np.flatnonzero(press[:, 2] > 0.0).tolist():
        lines = f"row {table.line[row]}"
        earlier = by_field.setdefault(table.field_t[row].tobytes(), row)
        if not np.array_equal(press[earlier], press[row]):
            raise DataError(
                f"{path}: {lines}, columns x_mm, y_mm, force_n: the same field as in row {table.line[earlier]} under "
                "another press: one of them is a copy with a wrong label"
            )
        earlier = by_press.setdefault(press[row].tobytes(), row)
        gap_ut = np.nan_to_num(np.abs(table.field_t[earlier] - table.field_t[row]) * 1e6)
        sensor, axis = np.unravel_index(np.argmax(gap_ut), gap_ut.shape)
        allowed_ut = REPEATABLE_UT + REPEATABLE_SHARE * abs(table.field_t[row, sensor, axis]) * 1e6
        if gap_ut[sensor, axis] > allowed_ut:
            raise DataError(
                f"{path}: {lines}, column b{sensor + 1}{'xyz'[axis]}_ut: {gap_ut[sensor, axis]:.0f} µT from row "
                f"{table.line[earlier]}, which has the same x_mm, y_mm and force_n: one of the labels is wrong"
            )


def _require_enough(path: Path, press: Array) -> None:
    if len(press) < FEWEST_PRESSES:
        raise DataError(f"{path}: {len(press)} presses; a calibration needs {FEWEST_PRESSES}, the paper's had 675")
    for column, name, fewest in ((0, "x_mm", FEWEST_PLACES), (1, "y_mm", FEWEST_PLACES), (2, "force_n", 2)):
        values = len(np.unique(press[:, column]))
        if values < fewest:
            raise DataError(f"{path}: column {name} has {values} different values; at least {fewest} are needed")
