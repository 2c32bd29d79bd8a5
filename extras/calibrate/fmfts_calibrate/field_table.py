"""Reads and writes CSV files of fields, the input of the offline verbs, and reads the baselines for them.

The columns are b1x_ut … bNz_ut, in µT; the sensors are in the order of the config.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from fmfts import baseline as baselines
from fmfts.baseline import BaselineError, Mounting
from fmfts.common.names import field_columns
from fmfts.common.reading import MOST_COLUMNS, damage_told, open_text, unreadable_told
from fmfts.pad import Array, Pad

LARGEST_FIELD_UT = 1000.0  # 10 G; the chip's largest range is 8.1 G


class DataError(Exception):
    """The file cannot be used; the text names file, row and column."""


@dataclass(frozen=True, slots=True)
class FieldTable:
    """field_t (K, N, 3): NaN where a cell is empty, or says that the chip clipped (`>800` or `<-800`).

    bound_t (K, N, 3): the end of the range there, with its sign; else NaN. others: all other columns, as text. line:
    where each row ends.
    """

    field_t: Array
    bound_t: Array
    others: dict[str, list[str]]
    line: list[int]


def read(path: Path, sensors: int, largest_ut: float = LARGEST_FIELD_UT) -> FieldTable:
    """Read a file. Raises DataError for a missing column, a cell that is not a number, or an impossible field.

    largest_ut: of a field that is possible; the default is for a pad with one magnet.
    """
    line, cells = read_cells(path)
    fields = field_columns(sensors)
    missing = [name for name in fields if name not in cells]
    if missing:
        raise DataError(f"{path}: row 1 has no column {', '.join(missing)} ({sensors} sensors are configured)")
    values = [
        [value_and_bound(path, at, name, cells[name][row], largest_ut) for name in fields]
        for row, at in enumerate(line)
    ]
    both = np.array(values).reshape(len(line), sensors, 3, 2) * 1e-6
    return FieldTable(
        field_t=both[..., 0],
        bound_t=both[..., 1],
        others={name: column for name, column in cells.items() if name not in fields},
        line=line,
    )


def read_cells(path: Path) -> tuple[list[int], dict[str, list[str]]]:
    """The line at which each row ends, and the columns by name, as text. Raises DataError where it is no table."""
    try:
        with unreadable_told(DataError, path), open_text(path) as file:
            text = file.read()  # at most as many bytes as a day of one frame a second
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: is not UTF-8 text (byte {error.start})") from error
    with damage_told(DataError, f"{path}: is not a table"):  # csv.Error: a cell is too long, or holds a zero byte
        return _cells(path, text)


def _cells(path: Path, text: str) -> tuple[list[int], dict[str, list[str]]]:
    lines = csv.DictReader(io.StringIO(text))
    header = list(lines.fieldnames or [])
    if not header:
        raise DataError(f"{path}: is empty: the first row names the columns, b1x_ut and so on")
    if len(header) > MOST_COLUMNS:
        raise DataError(f"{path}: row 1 has {len(header)} columns, and may have {MOST_COLUMNS}")
    if len(header) == 1 and (other := [mark for mark in ";\t" if mark in header[0]]):
        raise DataError(
            f"{path}: row 1: columns are separated by {other[0]!r}, not by ','; numbers need a decimal point"
        )
    rows = [(lines.line_num, row) for row in lines]
    if not rows:
        raise DataError(f"{path}: there is no row below the header")
    for line, row in rows:
        _require_as_many(path, line, row, header)
    return [line for line, _ in rows], {name: [row[name] for _, row in rows] for name in header}


def write(columns: Mapping[str, Sequence[str]], out: TextIO) -> None:
    """Write columns of equal length as CSV."""
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))


def mounting_of(path: Path, pad: Pad) -> Mounting:
    """The mounting of `pad` from the baseline file at `path`. Raises DataError where the file cannot be used."""
    try:
        baseline = baselines.load(path, pad)
        if baseline is None:
            raise DataError(f"{path}: there is no such baseline")
        return baseline.mounting(pad)
    except BaselineError as error:
        raise DataError(str(error)) from error


def _require_as_many(path: Path, line: int, row: Mapping[str | None, object], header: Sequence[str]) -> None:
    """Checks the number of cells in a row. csv.DictReader puts surplus cells under None; missing cells are None."""
    surplus = row.get(None, [])
    cells = len(header) - list(row.values()).count(None) + (len(surplus) if isinstance(surplus, list) else 0)
    if cells != len(header):
        raise DataError(f"{path}: row {line} has {cells} cells, the header {len(header)}: was it cut off?")


def value_and_bound(path: Path, line: int, name: str, cell: str, largest_ut: float) -> tuple[float, float]:
    """A field in µT and the end of the range at which it was clipped; one of them is NaN, of an empty cell both."""
    text = cell.strip()
    if not text:
        return math.nan, math.nan
    try:
        value = float(text.lstrip("<>"))
    except ValueError:
        raise DataError(f"{path}: row {line}, column {name}: '{cell}' is not a number") from None
    if not math.isfinite(value):
        raise DataError(f"{path}: row {line}, column {name}: '{cell}' is not a number; leave the cell empty")
    if abs(value) > largest_ut:
        raise DataError(
            f"{path}: row {line}, column {name}: {cell} µT is beyond any range of the chips: "
            "is the column in another unit? 1 G = 100 µT"
        )
    if text[0] not in "<>":
        return value, math.nan
    if (text[0] == ">") != (value > 0.0):
        raise DataError(f"{path}: row {line}, column {name}: '{cell}': a clipped value is >LIMIT or <-LIMIT")
    return math.nan, value
