"""Reads fields that are labelled by forces in three directions, of any pad; the place of a press is optional.

Columns: force_x_n, force_y_n, force_z_n; b1x_ut … bNz_ut, for each sensor those axes that it has; and, where known,
session (a name: another day, or another mounting; else each file is one) and rest (1 where nothing touches). An empty
cell is a value that is missing, `>33000` or `<-33000` one that the chip clipped: only that value is left out.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmfts.common.reading import digest_of
from fmfts.pad import Array
from fmfts_calibrate.field_table import DataError, read_cells, value_and_bound
from fmfts_skin.force_model import FORCE, MOST_VALUES

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]
VALUE = re.compile(r"b([1-9][0-9]*)([xyz])_ut")
LARGEST_UT = 200_000.0  # twice what any chip for magnets in contact pads reads
LARGEST_FORCE_N = 1000.0
# If no rows are marked as rest: the rows whose force exceeds the lightest by at most this share of the largest.
LIGHT = 0.01
FEWEST_OF_A_SESSION = 60


@dataclass(frozen=True, slots=True)
class ForceSet:
    """names (V,): of the values, such as b1x. field_ut (K, V): NaN where missing or clipped.

    bound_ut (K, V): the end of the range at which a value was clipped, with its sign; else NaN. force_n (K, 3). session
    (K,): which of `sessions`. rest (K,): nothing touches.
    """

    names: tuple[str, ...]
    field_ut: Array
    bound_ut: Array
    force_n: Array
    session: Indices
    sessions: tuple[str, ...]
    rest: Mask
    digest: str

    def rows(self, members: Mask) -> ForceSet:
        """A part of the rows."""
        return replace(
            self,
            field_ut=self.field_ut[members],
            bound_ut=self.bound_ut[members],
            force_n=self.force_n[members],
            session=self.session[members],
            rest=self.rest[members],
        )

    @property
    def clipped(self) -> Mask:
        """(K,): rows with a clipped value."""
        clipped: Mask = np.asarray(np.isfinite(self.bound_ut).any(axis=1), dtype=np.bool_)
        return clipped

    @property
    def sensor(self) -> Indices:
        """(V,): the sensor of each value."""
        return np.array([int(name[1:-1]) for name in self.names]) - 1

    @property
    def axis(self) -> Indices:
        """(V,): 0, 1 or 2 for x, y or z."""
        return np.array(["xyz".index(name[-1]) for name in self.names])

    def rest_ut(self, session: int) -> Array:
        """(V,): the mean field of a session's untouched rows, else of its lightest."""
        rows = self.session == session
        unloaded = rows & self.rest
        if not unloaded.any():
            size = np.linalg.norm(self.force_n, axis=1)
            unloaded = rows & (size <= size[rows].min() + LIGHT * size.max())
        with np.errstate(invalid="ignore"):
            known = np.isfinite(self.field_ut[unloaded])
            rest: Array = np.where(known, self.field_ut[unloaded], 0.0).sum(axis=0) / known.sum(axis=0)
        return rest

    def change(self) -> Array:
        """(K, V): the change from the session's rest, over the rms of the rest: the same for magnets of any moment."""
        out = np.empty_like(self.field_ut)
        for session in np.unique(self.session):
            rest = self.rest_ut(int(session))
            rows = self.session == session
            out[rows] = (self.field_ut[rows] - rest) / scale_of(rest)
        return out


def scale_of(rest: Array) -> float:
    """The rms of a rest field (V,)."""
    return float(np.sqrt(np.mean(rest * rest)))


def read_force_set(paths: Sequence[Path]) -> ForceSet:
    """The rows of all files. Raises DataError, which names file, row and column."""
    parts = [_read(path) for path in paths]
    names = parts[0].names
    for path, part in zip(paths, parts, strict=True):
        if part.names != names:
            raise DataError(f"{path}: has fields {', '.join(part.names)}, and {paths[0]} has {', '.join(names)}")
    told = [part.sessions[one] for part in parts for one in part.session]
    sessions = tuple(dict.fromkeys(told))
    if sum(len(part.sessions) for part in parts) != len(sessions):
        raise DataError(f"{', '.join(map(str, paths))}: two files have a session of the same name: rename one of them")
    whole = ForceSet(
        names,
        np.concatenate([part.field_ut for part in parts]),
        np.concatenate([part.bound_ut for part in parts]),
        np.concatenate([part.force_n for part in parts]),
        np.array([sessions.index(name) for name in told]),
        sessions,
        np.concatenate([part.rest for part in parts]),
        parts[0].digest
        if len(parts) == 1
        else hashlib.sha256("".join(one.digest for one in parts).encode()).hexdigest(),
    )
    for number, name in enumerate(sessions):
        if not np.isfinite(whole.rest_ut(number)).all():
            raise DataError(f"session {name!r}: its untouched or lightest rows lack a value: the rest is not known")
    return whole


def _read(path: Path) -> ForceSet:
    line, cells = read_cells(path)
    missing = [name for name in FORCE if name not in cells]
    if missing:
        raise DataError(f"{path}: row 1 has no column {', '.join(missing)}: all three directions are needed")
    columns = sorted((name for name in cells if VALUE.fullmatch(name)), key=_order)
    if not 2 <= len(columns) <= MOST_VALUES:
        raise DataError(
            f"{path}: row 1 names {len(columns)} of the fields b1x_ut, b1y_ut …: from 2 to {MOST_VALUES} are needed"
        )
    fields = [
        [value_and_bound(path, at, name, cell, LARGEST_UT) for at, cell in zip(line, cells[name], strict=True)]
        for name in columns
    ]
    force = [[_force(path, at, name, cell) for at, cell in zip(line, cells[name], strict=True)] for name in FORCE]
    both = np.array(fields)  # (V, K, 2)
    names = cells.get("session", [path.name] * len(line))
    sessions = tuple(dict.fromkeys(names))
    rest = [cell.strip() == "1" for cell in cells.get("rest", [""] * len(line))]
    return ForceSet(
        tuple(name.removesuffix("_ut") for name in columns),
        both[:, :, 0].T,
        both[:, :, 1].T,
        np.array(force).T,
        np.array([sessions.index(name) for name in names]),
        sessions,
        np.array(rest, dtype=np.bool_),
        digest_of(path),
    )


def _order(name: str) -> tuple[int, str]:
    match = VALUE.fullmatch(name)
    assert match is not None
    return int(match[1]), match[2]


def _force(path: Path, line: int, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not abs(value) <= LARGEST_FORCE_N:
        raise DataError(
            f"{path}: row {line}, column {name}: {cell!r} is no number up to {LARGEST_FORCE_N:g}: is the unit right?"
        )
    return value
