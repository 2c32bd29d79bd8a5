"""A force log of another machine and a recording of frames, each on its own clock, made into one table.

Both show when the pad was pressed: the log by its force, the frames by how far the field is from rest. The lag at which
they correlate best is the difference of the clocks.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmfts.collect.errors import RefusedError
from fmfts.sensor import Frame

Array = NDArray[np.float64]

GRID_HZ = 200.0
LEAST_CORRELATION = 0.8
# The next best lag outside the peak must be clearly worse: regular presses look alike at every period.
AMBIGUOUS = 0.97
PEAK_S = 0.5
STEADY_FORCE = 0.02
STEADY_FORCE_N = 0.01
EDGE_S = 0.1  # of a plateau, left out on both sides: creep, and what the lag may be off


@dataclass(frozen=True, slots=True)
class Log:
    """time_s (K,) on the machine's clock; place_mm (K, 2); force_n (K,)."""

    time_s: Array
    place_mm: Array
    force_n: Array


@dataclass(frozen=True, slots=True)
class Alignment:
    """lag_s: frames' time − log's time. correlation: at that lag, 1 at best."""

    lag_s: float
    correlation: float


@dataclass(frozen=True, slots=True)
class Plateau:
    """One steady press, or a pause, on the log's clock."""

    begun_s: float
    ended_s: float
    x_mm: float
    y_mm: float
    force_n: float

    @property
    def untouched(self) -> bool:
        return abs(self.force_n) <= STEADY_FORCE_N


def read_log(path: Path) -> Log:
    """A CSV with t_s, x_mm, y_mm and force_n. RefusedError, naming row and column, where it is not."""
    names = ("t_s", "x_mm", "y_mm", "force_n")
    try:
        with path.open(encoding="utf-8-sig", newline="") as lines:
            reader = csv.DictReader(lines)
            missing = [name for name in names if name not in (reader.fieldnames or [])]
            if missing:
                raise RefusedError(f"{path}: row 1 has no column {', '.join(missing)}")
            table = [[_number(path, reader.line_num, name, row[name]) for name in names] for row in reader]
    except (OSError, UnicodeDecodeError) as error:
        raise RefusedError(f"{path}: cannot be read: {error}") from error
    values = np.array(table).reshape(-1, len(names))
    if len(values) < 2 or not (np.diff(values[:, 0]) > 0.0).all():
        raise RefusedError(f"{path}: t_s must rise from row to row, over at least two")
    return Log(values[:, 0], values[:, 1:3], values[:, 3])


def align(log: Log, frames: Sequence[Frame], rest_t: Array) -> Alignment:
    """The lag of the best correlation; `rest_t` (N, 3): the untouched pad's field. RefusedError for none to believe."""
    time_s = np.array([frame.host_time_ns for frame in frames]) * 1e-9
    field_t = np.array([frame.field_t for frame in frames]).reshape(len(frames), -1)
    away = np.linalg.norm(np.nan_to_num(field_t - rest_t.ravel()), axis=1)
    pressed, moved = _on_grid(log.time_s, np.abs(log.force_n)), _on_grid(time_s, away)
    size = 1 << int(np.ceil(np.log2(len(pressed) + len(moved))))
    product = np.fft.rfft(moved, size) * np.conj(np.fft.rfft(pressed, size))
    correlation = np.fft.irfft(product, size) / (np.linalg.norm(pressed) * np.linalg.norm(moved) or 1.0)
    best = int(np.argmax(correlation))
    peak = float(correlation[best])
    if peak < LEAST_CORRELATION:
        raise RefusedError(
            f"log and frames correlate by {peak:.2f} at best, less than {LEAST_CORRELATION:g}: are they of one session?"
        )
    away_from_peak = np.abs((np.arange(size) - best + size // 2) % size - size // 2) > PEAK_S * GRID_HZ
    second = float(correlation[away_from_peak].max())
    if second > AMBIGUOUS * peak:
        raise RefusedError(
            f"log and frames fit as well at another lag (correlation {second:.3f} beside {peak:.3f}): press once in an "
            "irregular rhythm at the beginning"
        )
    steps = best if best < size // 2 else best - size
    lag_s = (steps + _vertex(correlation, best)) / GRID_HZ + float(time_s[0]) - float(log.time_s[0])
    return Alignment(lag_s, peak)


def plateaus(log: Log, least_s: float) -> list[Plateau]:
    """Where force and place were steady for at least `least_s`, edges left out."""
    found: list[Plateau] = []
    begin = 0
    for end in range(1, len(log.time_s) + 1):
        if end < len(log.time_s) and _steady(log, begin, end + 1):
            continue
        begun_s, ended_s = log.time_s[begin] + EDGE_S, log.time_s[end - 1] - EDGE_S
        force_n = float(log.force_n[begin:end].mean())
        if ended_s - begun_s >= least_s:
            x_mm, y_mm = log.place_mm[begin:end].mean(axis=0)
            found.append(Plateau(float(begun_s), float(ended_s), float(x_mm), float(y_mm), force_n))
        begin = end
    return found


def _steady(log: Log, begin: int, end: int) -> bool:
    force, place = log.force_n[begin:end], log.place_mm[begin:end]
    allowed = max(STEADY_FORCE * abs(float(force[0])), STEADY_FORCE_N)
    return bool(abs(force[-1] - force[0]) <= allowed and (np.abs(place[-1] - place[0]) < 0.01).all())


def _on_grid(time_s: Array, value: Array) -> Array:
    """Evenly sampled, without its mean."""
    grid = np.arange(time_s[0], time_s[-1], 1.0 / GRID_HZ)
    even = np.interp(grid, time_s, value)
    centred: Array = even - even.mean()
    return centred


def _vertex(values: Array, at: int) -> float:
    """Where between samples the parabola through three of them has its top, −½ to ½."""
    before, here, after = (float(values[(at + step) % len(values)]) for step in (-1, 0, 1))
    curvature = before - 2.0 * here + after
    return 0.0 if curvature == 0.0 else 0.5 * (before - after) / curvature


def _number(path: Path, line: int, name: str, cell: str | None) -> float:
    try:
        value = float(cell or "")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise RefusedError(f"{path}: row {line}, column {name}: '{cell}' is not a number")
    return value
