"""Reads the force log of another machine, and finds the presses in it: plateaus where force and place are steady."""

from __future__ import annotations

import csv
from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmfts.common.reading import MOST_COLUMNS, open_text, shortened
from fmfts_collect.errors import RefusedError

Array = NDArray[np.float64]

MEAN_S = 0.1  # means over this time are compared, because single readings scatter more than a plateau may drift
STEADY_FORCE = 0.02
STEADY_FORCE_N = 0.01
STEADY_PLACE_MM = 0.01
NOISE_DEVIATIONS = 4.0  # the noise of a mean may be this many deviations: an hour has 36,000 means
EDGE_S = 0.1  # this much is left out at both ends of a plateau, because the lag may be wrong by as much
MOST_ROWS = 4_000_000  # rows of an hour at 1 kHz
LONGEST_GAP = 3.0  # a longer gap, in rows or means, ends a plateau: nobody knows what happened in it


@dataclass(frozen=True, slots=True)
class Log:
    """time_s (K,) on the machine's clock; place_mm (K, 2), NaN where the log has no places; force_n (K,), not yet
    corrected for the gauge's zero."""

    time_s: Array
    place_mm: Array
    force_n: Array


@dataclass(frozen=True, slots=True)
class Plateau:
    """A steady press, or a pause: rows `first` to `end` − 1 of the log, without the edges."""

    first: int
    end: int
    begun_s: float
    ended_s: float
    x_mm: float
    y_mm: float


def read_log(path: Path) -> Log:
    """Read a CSV file with columns t_s, force_n, and x_mm and y_mm or neither. Raises RefusedError, which names row and
    column."""
    names: tuple[str, ...] = ("t_s", "force_n", "x_mm", "y_mm")
    table = array("d")
    try:
        with open_text(path) as lines:
            reader = csv.reader(lines)
            header = next(reader, [])
            if not any(name in header for name in names[2:]):
                names = names[:2]
            missing = [name for name in names if name not in header[:MOST_COLUMNS]]
            if missing:
                raise RefusedError(f"{path}: row 1 has no column {', '.join(missing)}")
            places = [header.index(name) for name in names]
            for count, row in enumerate(filter(None, reader)):
                if count == MOST_ROWS:
                    raise RefusedError(f"{path}: has more than {MOST_ROWS:,} rows: divide it, or log more slowly")
                for name, place in zip(names, places, strict=True):
                    table.append(_number(path, reader.line_num, name, row[place] if place < len(row) else ""))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RefusedError(f"{path}: cannot be read: {error}") from error
    values = np.array(table).reshape(-1, len(names))
    if len(values) < 2 or not (np.diff(values[:, 0]) > 0.0).all():
        raise RefusedError(f"{path}: t_s must rise from row to row, over at least two")
    place_mm = values[:, 2:] if len(names) > 2 else np.full((len(values), 2), np.nan)
    return Log(values[:, 0], place_mm, values[:, 1])


def plateaus(log: Log, settle_s: float, least_s: float) -> list[Plateau]:
    """The plateaus that are at least `least_s` long after `settle_s` (silicone creeps) and without the edges."""
    first = _first_rows(log.time_s)
    count = np.diff(first, append=len(log.time_s))
    values = np.column_stack([log.force_n, np.nan_to_num(log.place_mm)])
    means = np.add.reduceat(values, first) / count[:, None]
    time_s = np.add.reduceat(log.time_s, first) / count
    # Most neighbouring rows differ only by the gauge's noise; the median ignores the few where a press begins or ends.
    noise_n = float(np.median(np.abs(np.diff(log.force_n)))) / 0.6745
    allowed_n = STEADY_FORCE_N + NOISE_DEVIATIONS * noise_n / np.sqrt(count)
    gap_s = LONGEST_GAP * max(MEAN_S, float(np.median(np.diff(log.time_s))))

    result: list[Plateau] = []
    begin = 0
    for end in range(1, len(first) + 1):
        if end < len(first) and time_s[end] - time_s[end - 1] < gap_s:
            plateau_mean = means[begin:end].mean(axis=0)
            force_off_n, *place_off_mm = np.abs(means[end] - plateau_mean)
            limit_n = max(STEADY_FORCE * abs(plateau_mean[0]), allowed_n[end])
            if force_off_n <= limit_n and max(place_off_mm) < STEADY_PLACE_MM:
                continue
        last = (first[end] if end < len(first) else len(log.time_s)) - 1
        begun_s = float(log.time_s[first[begin]]) + max(EDGE_S, settle_s)
        ended_s = float(log.time_s[last]) - EDGE_S
        inside, after = np.searchsorted(log.time_s, [begun_s, ended_s]).tolist()
        if ended_s - begun_s >= least_s and inside < after:
            x_mm, y_mm = log.place_mm[inside:after].mean(axis=0).tolist()
            result.append(Plateau(inside, after, begun_s, ended_s, x_mm, y_mm))
        begin = end
    return result


def _first_rows(time_s: Array) -> NDArray[np.int64]:
    """The first row of each interval of MEAN_S; intervals without rows are left out."""
    number = np.floor((time_s - time_s[0]) / MEAN_S)
    return np.flatnonzero(np.diff(number, prepend=-1.0))


def _number(path: Path, line: int, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise RefusedError(f"{path}: row {line}, column {name}: '{shortened(cell)}' is not a number")
    return value
