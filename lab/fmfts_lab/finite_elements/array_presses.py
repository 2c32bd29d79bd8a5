"""Solves presses of the second standard pad (2 × 2 magnets) by finite elements, as CSV: one finger, or two at once.

python -m fmfts_lab.finite_elements.array_presses SET OUT.csv

SET: normal (the table's grid), centre (a finer grid round a magnet), shear (linear: the answer to 1 N along x, by
reciprocity), test-one, test-shear or test-pairs. Rows that OUT.csv has already are not solved again, so an interrupted
run goes on where it was.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from fmfts.pad import Array
from fmfts.view.progress import progress_bar
from fmfts_lab.finite_elements.array_pad import PLACES_M
from fmfts_lab.finite_elements.finite_element import PressedSlab
from fmfts_lab.finite_elements.slab import ELEMENT_M, Press, Slab
from fmfts_lab.finite_elements.solved_presses import (
    drop_incomplete_line,
    made_of,
    octant,
    pose_columns,
    press_columns,
    require_same,
)

FORCE_N = (0.4, 1.0, 1.8, 3.0)
FINE_MM = 4  # half the side of the square round a magnet where the grid is finer
SEED = 20261123
RAMP_N = 1.0
HALVINGS = 4
PATIENCE = 8
PRESS_COLUMNS = ("x_mm", "y_mm", "force_n", "shear_x_n", "shear_y_n")
Presses = tuple[Press, ...]


def array_slab() -> Slab:
    return Slab(magnets_m=PLACES_M)


def columns_of(fingers: int) -> list[str]:
    presses = [f"{name}_{i}" if fingers > 1 else name for i in range(1, fingers + 1) for name in PRESS_COLUMNS]
    return presses + [f"{name}_{i + 1}" for i in range(4) for name in ("dx_um", "dy_um", "dz_um", "axis_x", "axis_y")]


def normal_grid() -> list[Presses]:
    return [(Press(x * 1e-3, y * 1e-3, force_n),) for x, y in octant() for force_n in FORCE_N]


def centre_grid() -> list[Presses]:
    """Places of a 1 mm grid in the octant, round the magnet at (6, 6) mm, that are not in `normal_grid`."""
    near = range(6 - FINE_MM, 6 + FINE_MM + 1)
    places = [(float(x), float(y)) for x in near for y in near if y <= x and (x % 2 or y % 2)]
    return [(Press(x * 1e-3, y * 1e-3, force_n),) for x, y in places for force_n in FORCE_N]


def set_of_one(count: int) -> list[Presses]:
    random = np.random.default_rng(SEED)
    return [(_anywhere(random, float(random.uniform(0.2, 2.0))),) for _ in range(count)]


def set_of_shear(count: int) -> list[Presses]:
    random, presses = np.random.default_rng(SEED + 1), list[Presses]()
    for _ in range(count):
        x_m, y_m, force_n, _, _ = _anywhere(random, float(random.uniform(0.2, 2.0)))
        angle, share = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.0, 0.3)
        shear_n = [round(float(share * force_n * along), 4) for along in (np.cos(angle), np.sin(angle))]
        presses.append((Press(x_m, y_m, force_n, *shear_n),))
    return presses


def set_of_pairs(count: int) -> list[Presses]:
    """Pairs 10 to 24 mm apart, of 0.4 to 2 N in all, the weaker at least a tenth of it."""
    random, pairs = np.random.default_rng(SEED + 2), list[Presses]()
    while len(pairs) < count:
        whole_n, share = random.uniform(0.4, 2.0), random.uniform(0.1, 0.5)
        one, other = _anywhere(random, whole_n * (1.0 - share)), _anywhere(random, whole_n * share)
        if 10e-3 <= np.hypot(one.x_m - other.x_m, one.y_m - other.y_m) <= 24e-3:
            pairs.append((one, other))
    return pairs


def _anywhere(random: np.random.Generator, force_n: float) -> Press:
    x_m, y_m = np.round(random.uniform(-12e-3, 12e-3, 2), 6).tolist()
    return Press(x_m, y_m, round(force_n, 4))


SETS: dict[str, Callable[[], list[Presses]]] = {
    "normal": normal_grid,
    "centre": centre_grid,
    "test-one": lambda: set_of_one(40),
    "test-shear": lambda: set_of_shear(30),
    "test-pairs": lambda: set_of_pairs(50),
}


def solve_into(path: Path, presses: Sequence[Presses], slab: Slab, element_m: float) -> Iterator[float]:
    """Append to the CSV at `path` the rows of `presses` that it lacks. Yields the share that is done."""
    require_same(path, made_of(slab, element_m))
    drop_incomplete_line(path)
    width, header = 5 * len(presses[0]), columns_of(len(presses[0]))
    known = [row[:width] for row in csv.reader(path.read_text().splitlines())] if path.exists() else []
    missing = [one for one in presses if _key(one) not in known]
    solved = PressedSlab(slab, element_m, PATIENCE)
    with path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not known:
            writer.writerow(header)
        done = len(presses) - len(missing)
        for _, group in groupby(missing, key=lambda one: [(press.x_m, press.y_m) for press in one]):
            solved.rest()
            before: Presses | None = None
            for one in group:
                before = before or tuple(Press(press.x_m, press.y_m, 0.0) for press in one)
                poses = _stepped(solved, before, one)
                writer.writerow([*_key(one), *(text for pose in poses for text in pose_columns(*pose))])
                file.flush()
                before, done = one, done + 1
                yield done / len(presses)


def _stepped(
    solved: PressedSlab, before: Presses, presses: Presses, halvings: int = HALVINGS
) -> list[tuple[Array, Array]]:
    """Solve `presses` starting from `before`, the state of `solved`; in two halves if the step is long or fails."""
    if sum(abs(one.force_n - other.force_n) for one, other in zip(before, presses, strict=True)) <= RAMP_N:
        try:
            return solved.solve_all(presses)
        except ArithmeticError:
            if halvings <= 0:
                raise
    middle = tuple(
        Press(one.x_m, one.y_m, *((a + b) / 2.0 for a, b in zip(other[2:], one[2:], strict=True)))
        for other, one in zip(before, presses, strict=True)
    )
    _stepped(solved, before, middle, halvings - 1)
    return _stepped(solved, middle, presses, halvings - 1)


def _key(presses: Presses) -> list[str]:
    return [text for press in presses for text in press_columns(press)]


def main(arguments: list[str]) -> int:
    if len(arguments) != 2 or arguments[0] not in SETS:
        print(__doc__, file=sys.stderr)
        return 2
    with threadpool_limits(1), progress_bar("solving") as show:
        for share in solve_into(Path(arguments[1]), SETS[arguments[0]](), array_slab(), ELEMENT_M):
            show(share)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
