"""Writes the collected table DATA.csv, and DATA.collection.json with its plan and pad. Recordings hold the frames.

Frames are on the disk before their row, and the row before the next press: however the program ends, each finished row
is there exactly once. When the work is continued, a row that a killed program wrote only in part is removed.
"""

from __future__ import annotations

import csv
import fcntl
import io
import os
from collections.abc import Sequence
from math import isnan
from pathlib import Path

import msgspec

from fmfts.common.names import field_columns
from fmfts.common.reading import damage_told, read_regular
from fmfts.common.writing import why_not_written
from fmfts.service.state import write_atomically
from fmfts_collect.errors import NotWrittenError, RefusedError

FORMAT = 2
LARGEST_HEADER_BYTES = 100_000
UNTOUCHED = 0  # the `press` of rows of the unloaded pad, whose field calibration needs too
LABELS = ("press", "x_mm", "y_mm", "force_n")
FACTS = ("force_sd_n", "frames", "temperature_c", "utc", "baseline", "pad", "board")
FRAMES = ("recording", "first_frame_ns", "last_frame_ns")


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The plan and the pad of a table; only work with the same ones may continue it."""

    format: int
    plan: str
    fingerprint: str
    pad: str
    geometry_hash: str

    def require_same(self, other: Header, path: Path) -> None:
        """Raise RefusedError, which names the difference, unless both are the same. path: the table of `other`."""
        for name in self.__struct_fields__:
            value, other_value = getattr(self, name), getattr(other, name)
            if value != other_value and name != "plan":
                what = "plan" if name == "fingerprint" else name.removesuffix("_hash")
                shown = other.plan if name == "fingerprint" else other_value
                raise RefusedError(
                    f"{path} was begun with another {what} ({shown}): give another file with -o, or remove that one"
                )


class Row(msgspec.Struct, frozen=True):
    """One line of DATA.csv. x_mm, y_mm: NaN where nobody knows the place; its cells are empty.

    field_ut: the magnet's field, x y z of each sensor in turn, in the sensors' own axes. recording: the file with its
    frames, whose host_time_ns are from first_frame_ns to last_frame_ns.
    """

    press: int
    x_mm: float
    y_mm: float
    force_n: float
    field_ut: Sequence[float]
    force_sd_n: float
    frames: int
    temperature_c: float | None
    utc: str
    baseline: str
    pad: str
    board: str
    recording: str
    first_frame_ns: int
    last_frame_ns: int

    def cells(self) -> list[str]:
        place = ["" if isnan(each) else f"{each:.4f}" for each in (self.x_mm, self.y_mm)]
        labels = [str(self.press), *place, f"{self.force_n:.5f}"]
        fields = [f"{value:.5f}" for value in self.field_ut]
        temperature = "" if self.temperature_c is None else f"{self.temperature_c:.3f}"
        facts = [f"{self.force_sd_n:.5f}", str(self.frames), temperature, self.utc, self.baseline, self.pad, self.board]
        frames = [self.recording, str(self.first_frame_ns), str(self.last_frame_ns)]
        return [*labels, *fields, *facts, *frames]


class Table:
    """A table on the disk; use it as a context manager. done: numbers of the finished presses."""

    def __init__(self, path: Path, sensors: int, header: Header) -> None:
        """Make a new table, or continue an existing one. Raises RefusedError if that is of other work, or damaged."""
        self.path = path
        self.header_path = path.with_suffix(".collection.json")
        columns = [*LABELS, *field_columns(sensors), *FACTS, *FRAMES]
        try:
            self._rows = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o666)
            try:
                self._require_alone()
                self._require_own(header)
                self.done = self._mend(columns)
                if os.fstat(self._rows).st_size == 0:
                    self._append(self._rows, _line(columns))
            except BaseException:
                os.close(self._rows)
                raise
        except OSError as error:
            raise NotWrittenError(f"{error.filename or path}: {why_not_written(error)}") from error

    def __enter__(self) -> Table:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._rows)

    def add(self, row: Row) -> None:
        """Write a row; it is on the disk when this returns. Raises NotWrittenError where that fails."""
        assert row.press not in self.done
        try:
            self._append(self._rows, _line(row.cells()))
        except OSError as error:
            raise NotWrittenError(f"{self.path}: {why_not_written(error)}; the same command goes on") from error
        self.done |= {row.press} - {UNTOUCHED}

    @staticmethod
    def _append(file: int, data: bytes) -> None:
        while data:
            data = data[os.write(file, data) :]
        os.fsync(file)

    def _require_alone(self) -> None:
        try:
            fcntl.flock(self._rows, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RefusedError(f"{self.path}: another collect is writing it: let that end, or stop it") from error

    def _require_own(self, header: Header) -> None:
        if os.fstat(self._rows).st_size == 0:
            write_atomically(self.header_path, msgspec.json.format(msgspec.json.encode(header), indent=1) + b"\n")
            return
        with damage_told(
            RefusedError, f"{self.path} exists, but its plan and pad cannot be read from {self.header_path}"
        ):
            before = msgspec.json.decode(read_regular(self.header_path, LARGEST_HEADER_BYTES), type=Header)
        header.require_same(before, self.path)

    def _mend(self, columns: list[str]) -> set[int]:
        """Removes an unfinished row from the file; returns the numbers of the finished presses."""
        lines = _whole_lines(self.path)
        if lines and lines[0] != ",".join(columns):
            raise RefusedError(f"{self.path}: its first line is not the header that belongs there")
        numbers = [self._number(at, line, len(columns)) for at, line in enumerate(lines[1:], start=2)]
        done = [number for number in numbers if number != UNTOUCHED]
        if len(done) != len(set(done)):
            raise RefusedError(f"{self.path}: it contains a press twice: was it edited?")
        return set(done)

    def _number(self, at: int, line: str, columns: int) -> int:
        """The number of the press in a line. at: number of the line."""
        try:
            (cells,) = csv.reader([line])
            number = int(cells[0])
        except (ValueError, IndexError, csv.Error):
            cells, number = [], -1
        if len(cells) != columns or number < UNTOUCHED:
            raise RefusedError(
                f"{self.path}, line {at}: {line[:40]!r} is not a row of a press: was it edited? Correct that line, or "
                "remove it, and its press will be repeated"
            )
        return number


def _whole_lines(path: Path) -> list[str]:
    """The complete lines of a file; removes an incomplete last line from it."""
    if not path.exists():
        return []
    data = path.read_bytes()
    end = data.rfind(b"\n") + 1
    if end < len(data):
        with path.open("rb+") as file:
            file.truncate(end)
    return data[:end].decode(errors="replace").split("\n")[:-1]


def _line(cells: Sequence[str]) -> bytes:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(cells)
    return out.getvalue().encode()
