"""Solves presses of the standard pad by finite elements, as CSV: the grids of the table, and sets to test it with.

python -m fmfts_lab.finite_elements.solved_presses SET OUT.csv

SET: normal, centre, shear, test-normal, test-shear, or test-friction: presses of more friction all over the pad, by
the probe of the table; test-friction-3: by one of 3 mm. Rows that OUT.csv has already are not solved again, so an
interrupted run goes on where it was.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import lru_cache
from itertools import groupby
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.pad import Array
from fmfts.view.progress import progress_bar
from fmfts_calibrate.sweep import Workers
from fmfts_lab.finite_elements.finite_element import PressedSlab
from fmfts_lab.finite_elements.slab import ELEMENT_M, Press, Slab
from fmfts_simulation.solved_table import COLUMNS

GRID_MM = range(0, 16, 2)
FORCE_N = (0.3, 0.8, 1.4, 2.0, 2.8, 4.0)
CENTRE_MM = 4
SHEARED_MM = 14  # the whole table
SHEARED_FORCE_N = (1.0, 2.0)
SHEAR_ALONE_N = 0.1  # shear without normal force, where the response is almost linear
SHEAR_SHARE = 0.4  # share of the normal force: a finger can transmit it, and it suffices to show the curvature
SHEAR_DIRECTIONS = 5  # the number of terms of a quadratic form without constant
RAMP_N = 1.0  # a larger step of force is split into two
HALVINGS = 4
SEED = 20260719


def octant(largest_mm: int = GRID_MM[-1]) -> Iterator[tuple[float, float]]:
    """Places (mm) 0 ≤ y ≤ x ≤ `largest_mm`; mirrored and turned by quarters they make the whole grid."""
    return ((float(x), float(y)) for x in GRID_MM for y in GRID_MM if y <= x <= largest_mm)


def normal_grid(reach_m: float = GRID_MM[-1] * 1e-3) -> list[Press]:
    """The normal presses of the table. Another `reach_m` scales the grid to a smaller or larger pad."""
    unit_m = reach_m / GRID_MM[-1]
    return [Press(x * unit_m, y * unit_m, force_n) for x, y in octant() for force_n in FORCE_N]


def centre_grid() -> list[Press]:
    """Presses around the magnet, where its tilt changes sign: places of a 1 mm grid that are not in `normal_grid`."""
    places = [(x, y) for x in range(CENTRE_MM + 1) for y in range(x + 1) if x % 2 or y % 2]
    return [Press(x * 1e-3, y * 1e-3, force_n) for x, y in places for force_n in FORCE_N]


def shear_grid() -> list[Press]:
    """The fewest presses that determine, with the normal ones, the linear and quadratic terms of shear."""
    presses = []
    for x, y in octant(SHEARED_MM):
        directions = shear_directions(x, y)
        # There are two linear terms, and a direction oblique to a mirror plane determines both.
        alone = directions[:2] if len(directions) == SHEAR_DIRECTIONS else directions[-2:][:1]
        loads = [(0.0, SHEAR_ALONE_N * direction) for direction in alone]
        loads += [
            (force_n, SHEAR_SHARE * force_n * direction) for force_n in SHEARED_FORCE_N for direction in directions
        ]
        presses += [Press(x * 1e-3, y * 1e-3, force_n, *np.round(shear_n, 4).tolist()) for force_n, shear_n in loads]
    return presses


def shear_directions(x_mm: float, y_mm: float) -> Array:
    """Unit vectors (D, 2) evenly in all directions, without mirror images in the symmetry planes through the place."""
    on_axis, on_diagonal = y_mm == 0.0, y_mm == x_mm
    count = 1 if on_axis and on_diagonal else SHEAR_DIRECTIONS // 2 + 1 if on_axis or on_diagonal else SHEAR_DIRECTIONS
    angle = 2.0 * np.pi / SHEAR_DIRECTIONS * np.arange(count) + (np.pi / 4.0 if on_diagonal and not on_axis else 0.0)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def normal_test(count: int = 90) -> list[Press]:
    """Test presses off the grid: places uniform in ±14 mm, forces in 0.28–1.98 N."""
    random = np.random.default_rng(SEED)
    place_m, force_n = (
        np.round(random.uniform(-14e-3, 14e-3, (count, 2)), 6),
        np.round(random.uniform(0.28, 1.98, count), 4),
    )
    return [Press(float(x), float(y), float(f)) for (x, y), f in zip(place_m, force_n, strict=True)]


def shear_test(count: int = 60) -> list[Press]:
    """Test presses off the grid: places in ±8 mm, shear in any direction up to half the normal force."""
    random = np.random.default_rng(SEED + 1)
    place_m, force_n = (
        np.round(random.uniform(-8e-3, 8e-3, (count, 2)), 6),
        np.round(random.uniform(0.28, 1.98, count), 4),
    )
    shear_n = force_n * random.uniform(0.0, 0.5, count)
    angle = random.uniform(0.0, 2.0 * np.pi, count)
    return [
        Press(float(x), float(y), float(f), round(float(s * np.cos(a)), 4), round(float(s * np.sin(a)), 4))
        for (x, y), f, s, a in zip(place_m, force_n, shear_n, angle, strict=True)
    ]


def friction_test(count: int, seed: int) -> list[Press]:
    """Test presses off the grid: places in ±14 mm, shear in any direction up to 0.8 of the normal force."""
    random = np.random.default_rng(seed)
    place_m = np.round(random.uniform(-14e-3, 14e-3, (count, 2)), 6)
    force_n = np.round(random.uniform(0.28, 1.98, count), 4)
    shear_n = force_n * random.uniform(0.0, 0.8, count)
    angle = random.uniform(0.0, 2.0 * np.pi, count)
    shears_n = np.round(shear_n[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), 4)
    rows = np.column_stack([place_m, force_n, shears_n]).tolist()
    return [Press(*(float(value) for value in row)) for row in rows]


SETS: dict[str, Callable[[], list[Press]]] = {
    "normal": normal_grid,
    "centre": centre_grid,
    "shear": shear_grid,
    "test-normal": normal_test,
    "test-shear": shear_test,
    "test-friction": lambda: friction_test(60, SEED + 2),
    "test-friction-3": lambda: friction_test(24, SEED + 3),
}
PROBE_M = {"test-friction-3": 3e-3}  # diameter, if it is not the table's


def solve_into(
    path: Path,
    presses: Sequence[Press],
    slab: Slab,
    element_m: float,
    show: Callable[[float], None],
    workers: Workers | None = None,
) -> None:
    """Append to the CSV at `path` the rows of `presses` that it lacks. `show` is called with the share that is done.

    workers: where each place is solved, with all its forces; None: here. A place is written when it is done, and at the
    end the file is in the order of `presses`, the same with any number of workers.
    Slab and element size are kept beside it as .json. ValueError if they differ, or if that file is missing.
    """
    require_same(path, made_of(slab, element_m))
    drop_incomplete_line(path)
    rows = {tuple(row[:5]): row for row in csv.reader(path.read_text().splitlines())} if path.exists() else {}
    missing = [press for press in presses if tuple(press_columns(press)) not in rows]
    places = [list(group) for _, group in groupby(missing, key=lambda press: (press.x_m, press.y_m))]
    with path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not rows:
            writer.writerow(COLUMNS)

        def keep(_: int, solved: list[list[str]]) -> None:
            writer.writerows(solved)
            file.flush()
            rows.update({tuple(row[:5]): row for row in solved})
            show(sum(tuple(press_columns(press)) in rows for press in presses) / len(presses))

        (workers or Workers()).map(solve_place, [(slab, element_m, place) for place in places], keep)
    _write_in_order(path, presses, rows)


def solve_place(slab: Slab, element_m: float, presses: Sequence[Press]) -> list[list[str]]:
    """Rows of presses at one place, each solved from the one before it."""
    with threadpool_limits(1):  # the same bits whatever runs beside it
        solved = _slab_of(slab, element_m)
        solved.rest()
        rows, before = [], Press(presses[0].x_m, presses[0].y_m, 0.0)
        for press in presses:
            displacement_m, axis = _stepped(solved, before, press)
            before = press
            rows.append([*press_columns(press), *pose_columns(displacement_m, axis)])
    return rows


@lru_cache(maxsize=1)
def _slab_of(slab: Slab, element_m: float) -> PressedSlab:
    """The mesh, made once in a process."""
    return PressedSlab(slab, element_m)


def _write_in_order(path: Path, presses: Sequence[Press], rows: dict[tuple[str, ...], list[str]]) -> None:
    """Rows that are not of `presses` come first, as they were."""
    own = [tuple(press_columns(press)) for press in presses]
    others = [row for key, row in rows.items() if key not in set(own) and key != COLUMNS[:5]]
    beside = path.with_suffix(".csv.new")
    with beside.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *others, *(rows[key] for key in own)])
    beside.replace(path)


def made_of(slab: Slab, element_m: float) -> str:
    """The description beside a table of presses. Tables of one magnet were made before there were several."""
    facts = asdict(slab)
    if slab.magnets_m == Slab().magnets_m:
        del facts["magnets_m"]
    return json.dumps({"slab": facts, "element_m": element_m}, indent=1) + "\n"


def require_same(path: Path, made_of: str) -> None:
    beside = path.with_suffix(".json")
    if beside == path:
        raise ValueError(f"{path}: a table of presses ends in .csv")
    has_rows = path.exists() and path.stat().st_size > 0
    if has_rows and (not beside.exists() or beside.read_text() != made_of):
        found = "tells of another slab or element size" if beside.exists() else "is not there to tell its slab"
        raise ValueError(f"{path}: holds presses already, and {beside} {found}: solve into another file")
    beside.write_text(made_of)


def drop_incomplete_line(path: Path) -> None:
    """Remove the line that an interrupted run was writing."""
    if path.exists():
        content = path.read_bytes()
        path.write_bytes(content[: content.rfind(b"\n") + 1])


def _stepped(solved: PressedSlab, before: Press, press: Press, halvings: int = HALVINGS) -> tuple[Array, Array]:
    """Solve `press` starting from `before`, the state of `solved`; in two halves if the step is long or fails."""
    if abs(press.force_n - before.force_n) <= RAMP_N:
        try:
            return solved.solve(press)
        except ArithmeticError:
            if halvings <= 0:
                raise
    loads = [(a + b) / 2.0 for a, b in zip(before[2:], press[2:], strict=True)]
    middle = Press(press.x_m, press.y_m, *loads)
    _stepped(solved, before, middle, halvings - 1)
    return _stepped(solved, middle, press, halvings - 1)


def press_columns(press: Press) -> list[str]:
    return [f"{press.x_m * 1e3:.6g}", f"{press.y_m * 1e3:.6g}", *(f"{force:.6g}" for force in press[2:])]


def pose_columns(displacement_m: Array, axis: Array) -> list[str]:
    return [
        *(f"{round(d * 1e6, 4) + 0.0:.4f}" for d in displacement_m),
        *(f"{round(a, 7) + 0.0:.7f}" for a in axis[:2]),
    ]


def main(arguments: list[str]) -> int:
    if len(arguments) != 2 or arguments[0] not in SETS:
        print(__doc__, file=sys.stderr)
        return 2
    with progress_bar("solving") as show:
        slab = Slab(patch_diameter_m=PROBE_M.get(arguments[0], Slab().patch_diameter_m))
        solve_into(Path(arguments[1]), SETS[arguments[0]](), slab, ELEMENT_M, show)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
