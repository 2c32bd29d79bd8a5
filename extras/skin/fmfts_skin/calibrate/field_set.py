"""Reads labelled fields of a pad whose magnets are unknown, such as an AnySkin, ReSkin or eFlesh skin.

Columns, in any order: b1x_ut, b1y_ut … bNz_ut, of as many sensors as there are; x_mm and y_mm, or neither where one
place is pressed; depth_mm, force_n or shear_n, one of them: the load. Then, where known, recording (a name: another
pad, or another day) and rest (1 where nothing touches). Rows stand in the order of time. Labels may be empty in rows
that only tell fields.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmfts.common.reading import MOST_COLUMNS, digest_of, open_text
from fmfts.pad import Array
from fmfts_calibrate.field_table import DataError, FieldTable, read
from fmfts_skin.field_response import LOADS, PLACE

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]
LARGEST_UT = 100_000.0  # an MLX90393 reads up to 50 mT along each axis
FEWEST_SENSORS = 2


@dataclass(frozen=True, slots=True)
class FieldSet:
    """axes: names of the contact's coordinates, D. contact (K, D): NaN where unknown. field_ut (K, P). rest (K,):
    nothing touches. recording (K,): which of `recordings`. digest: SHA-256 of the file."""

    axes: tuple[str, ...]
    contact: Array
    field_ut: Array
    rest: Mask
    recording: Indices
    recordings: tuple[str, ...]
    digest: str

    def rows(self, members: Mask) -> FieldSet:
        """A part of the rows."""
        return replace(
            self,
            contact=self.contact[members],
            field_ut=self.field_ut[members],
            rest=self.rest[members],
            recording=self.recording[members],
        )

    @property
    def labelled(self) -> Mask:
        """(K,): rows of contacts whose coordinates are all known."""
        known: Mask = np.isfinite(self.contact).all(axis=1) & ~self.rest
        return known

    def rest_ut(self) -> Array:
        """(K, P): at each row, the mean of the newest consecutive unloaded rows before it in its recording.

        Rows before the first rest have that one; rows of a recording without any have NaN.
        """
        out = np.full(self.field_ut.shape, np.nan)
        for number in range(len(self.recordings)):
            rows = np.flatnonzero(self.recording == number)
            unloaded = self.rest[rows]
            starts = np.flatnonzero(unloaded & ~np.concatenate([[False], unloaded[:-1]]))
            ends = np.flatnonzero(unloaded & ~np.concatenate([unloaded[1:], [False]])) + 1
            for index, (start, end) in enumerate(zip(starts, ends, strict=True)):
                out[rows[0 if index == 0 else start :]] = self.field_ut[rows[start:end]].mean(axis=0)
        return out


def read_field_set(path: Path) -> FieldSet:
    """Raises DataError, which names file, row and column."""
    sensors = _sensors(path)
    table = read(path, sensors, LARGEST_UT)
    axes = _axes(path, table)
    fields = table.field_t.reshape(len(table.line), -1) * 1e6
    if not np.isfinite(fields).all():
        row = int(np.flatnonzero(~np.isfinite(fields).all(axis=1))[0])
        raise DataError(f"{path}: row {table.line[row]}: a field is missing; leave the row out")
    names = table.others.get("recording", [""] * len(fields))
    recordings = tuple(dict.fromkeys(names))
    rest = np.array([_flag(path, line, cell) for line, cell in zip(table.line, _rest(table), strict=True)])
    contact = np.array([[_label(path, table, row, name) for name in axes] for row in range(len(fields))])
    return FieldSet(
        axes,
        contact,
        fields,
        rest,
        np.array([recordings.index(name) for name in names]),
        recordings,
        digest_of(path),
    )


def _header(path: Path) -> list[str]:
    try:
        with open_text(path) as file:
            return next(csv.reader(file), [])[:MOST_COLUMNS]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error


def _sensors(path: Path) -> int:
    header = set(_header(path))
    sensors = 0
    while {f"b{sensors + 1}{axis}_ut" for axis in "xyz"} <= header:
        sensors += 1
    surplus = sorted(name for name in header if name[:1] == "b" and name.endswith("_ut"))
    if sensors < FEWEST_SENSORS or len(surplus) != 3 * sensors:
        raise DataError(
            f"{path}: row 1: columns b1x_ut, b1y_ut, b1z_ut, b2x_ut … are needed, three of each sensor and at least "
            f"{FEWEST_SENSORS} sensors; there are {', '.join(surplus) or 'none'}"
        )
    return sensors


def _axes(path: Path, table: FieldTable) -> tuple[str, ...]:
    places = [name for name in PLACE if name in table.others]
    if len(places) == 1:
        raise DataError(f"{path}: row 1 has {places[0]} alone: a place has x_mm and y_mm")
    loads = [name for name in LOADS if name in table.others]
    if len(loads) != 1:
        raise DataError(
            f"{path}: row 1 names {' and '.join(loads) or 'no load'}: one of {', '.join(LOADS)} is needed, "
            "and a table is made for one of them"
        )
    return (*places, *loads)


def _rest(table: FieldTable) -> list[str]:
    return table.others.get("rest", ["0"] * len(table.line))


def _flag(path: Path, line: int, cell: str) -> bool:
    if cell.strip() not in ("", "0", "1"):
        raise DataError(f"{path}: row {line}, column rest: '{cell}': 1 where nothing touches the pad, else 0")
    return cell.strip() == "1"


def _label(path: Path, table: FieldTable, row: int, name: str) -> float:
    cell = table.others[name][row]
    try:
        value = float(cell) if cell.strip() else float("nan")
    except ValueError:
        value = float("inf")
    if np.isinf(value):
        raise DataError(f"{path}: row {table.line[row]}, column {name}: '{cell}' is not a number")
    return value
