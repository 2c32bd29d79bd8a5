"""Solves presses of pads of other thickness and Poisson's ratio by CalculiX, with other fingers: `bench structure`.

python -m fmfts_lab.finite_elements.cast_presses OUT.csv

A minute of one core for each of 80 ramps. Presses that OUT.csv has already are not solved again.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from fmfts_lab.finite_elements.check_calculix import LEVELS, solved_ramp
from fmfts_lab.finite_elements.slab import Press, Slab
from fmfts_lab.finite_elements.slab_mesh import SlabMesh
from fmfts_lab.finite_elements.solved_presses import pose_columns

COLUMNS = (
    *("thickness_mm", "finger_mm", "poisson", "x_mm", "y_mm", "shear_x_share", "shear_y_share"),
    *("force_n", "dx_um", "dy_um", "dz_um", "axis_x", "axis_y"),
)
PADS_MM = ((4.0, 6.0), (3.6, 6.0), (4.4, 6.0), (4.0, 3.0), (4.0, 12.0), (3.6, 12.0), (4.4, 3.0))
PLACES_MM = ((0.7, 0.4), (3.4, 1.3), (6.2, 2.6), (9.0, 4.8))
LARGEST_N, FRICTION = 2.4, 0.3
ELEMENT_M = 2e-3  # 3 % too stiff (lab/results/pad-model.md): a disadvantage for the model that is judged
SEED = 45
# Quarter turns of a ramp's shear that are solved, too: on this pad shear acts evenly along and across the radius.
TURNED_MM, TURNS = (4.0, 6.0), 3
# Without shear, another Poisson's ratio than the slab's own, too.
# Ratios near 0.5 cannot be solved with these elements: they lock, and 0.4999 sinks 24 % too little. See poisson.py.
POISSON, SOFTER_POISSON = 0.49, 0.47
SOFTER_MM = {(4.0, 6.0): 4, (3.6, 12.0): 4, (4.4, 3.0): 2, (3.6, 6.0): 1, (4.4, 6.0): 1}  # at so many of the places


def ramps() -> Iterator[tuple[float, ...]]:
    """The first seven columns of each ramp: without shear, then with friction in a direction of its own; on the pad
    TURNED_MM with the three directions at right angles to it, too. At last the other Poisson's ratio."""
    random = np.random.default_rng(SEED)
    angle = {(pad, place): random.uniform(0.0, 2.0 * np.pi) for pad in PADS_MM for place in PLACES_MM}
    for friction in (0.0, FRICTION):
        for place in PLACES_MM:
            for pad in PADS_MM:
                towards = angle[pad, place]
                x, y = (np.round(friction * np.array([np.cos(towards), np.sin(towards)]), 4) + 0.0).tolist()
                yield (*pad, POISSON, *place, x, y)
                for _ in range(TURNS if friction and pad == TURNED_MM else 0):
                    x, y = -y, x
                    yield (*pad, POISSON, *place, x, y)
    for pad, places in SOFTER_MM.items():
        yield from ((*pad, SOFTER_POISSON, *place, 0.0, 0.0) for place in PLACES_MM[:places])


def silicone(poisson: float) -> Slab:
    """The standard slab's Young's modulus with another Poisson's ratio."""
    slab = Slab()
    if poisson == POISSON:
        return slab
    shear, bulk = slab.shear_modulus_pa, slab.bulk_pa
    young = 9.0 * bulk * shear / (3.0 * bulk + shear)
    softer = young / (2.0 * (1.0 + poisson)) / shear
    return replace(
        slab, c10_pa=softer * slab.c10_pa, c01_pa=softer * slab.c01_pa, bulk_pa=young / (3.0 * (1.0 - 2.0 * poisson))
    )


def solve(ramp: tuple[float, ...]) -> Iterator[list[str]]:
    thickness_mm, finger_mm, poisson, x_mm, y_mm, *shear = ramp
    slab = replace(silicone(poisson), thickness_m=thickness_mm * 1e-3, patch_diameter_m=finger_mm * 1e-3)
    press = Press(x_mm * 1e-3, y_mm * 1e-3, LARGEST_N, *(LARGEST_N * share for share in shear))
    poses = solved_ramp(slab, SlabMesh.of(slab, ELEMENT_M), press)
    for level, (displacement_m, axis) in zip(LEVELS, poses, strict=True):
        yield [*(f"{value:g}" for value in (*ramp, level * LARGEST_N)), *pose_columns(displacement_m, axis)]


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    path = Path(arguments[0])
    known = {tuple(row[:7]) for row in csv.reader(path.read_text().splitlines())} if path.exists() else set()
    with path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not known:
            writer.writerow(COLUMNS)
        for ramp in ramps():
            if tuple(f"{value:g}" for value in ramp) not in known:
                writer.writerows(solve(ramp))
                file.flush()
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
