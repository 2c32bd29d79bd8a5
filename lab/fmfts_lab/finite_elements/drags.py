"""Drags a rigid ball over the standard pad with friction, by CalculiX (Debian: calculix-ccx): it sticks, then slips.

python -m fmfts_lab.finite_elements.drags OUT.csv [--case NAME]

Another solver, other elements (C3D8I) and another load than those of the table of presses (`solved_presses`: felupe,
Q1P0, an even traction): here a ball is pressed in and dragged sideways, and Coulomb's law decides what sticks.
CalculiX's contact is face to face with penalties: NORMAL_MPA_PER_MM and STICK_MPA_PER_MM. A case takes five
to twelve minutes of one core. Drags that OUT.csv has already are not solved again.
"""

from __future__ import annotations

import argparse
import csv
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array
from fmfts_lab.finite_elements.check_calculix import point_set
from fmfts_lab.finite_elements.finite_element import MAGNET_STIFFNESS, MPA
from fmfts_lab.finite_elements.slab import Slab
from fmfts_lab.finite_elements.slab_mesh import MM, SlabMesh

COLUMNS = (
    *("case", "friction", "ball_mm", "way_mm", "x_mm", "y_mm", "force_n", "shear_x_n", "shear_y_n"),
    *("dx_um", "dy_um", "dz_um", "axis_x", "axis_y"),
)
NORMAL_MPA_PER_MM, STICK_MPA_PER_MM = 5.0, 20.0
GAP_MM, BALL_ELEMENT_MM = 1e-3, 0.9
PRESSING, DRAGGING = 8, 20  # increments
FINE_MM, COARSE_MM = 1.0, 3.0
HEIGHTS_MM = (0.0, 1.0, 2.0, 3.0, 3.5, 4.0)


@dataclass(frozen=True, slots=True)
class Drag:
    """ball_mm: its radius; cap_mm: width of the part that is meshed. It is pressed in by depth_mm at (x, y), and then
    dragged by way_mm along `angle_rad`, at this depth. flat_mm: radius of a flat face, whose edge is the ball."""

    friction: float
    ball_mm: float
    cap_mm: float
    x_mm: float
    y_mm: float
    depth_mm: float
    way_mm: float
    angle_rad: float
    flat_mm: float = 0.0

    @property
    def along(self) -> Array:
        return np.array([np.cos(self.angle_rad), np.sin(self.angle_rad)])

    @property
    def reach_mm(self) -> float:
        """The distance from the middle up to which the mesh must be fine."""
        start = np.array([self.x_mm, self.y_mm])
        farthest = max(np.abs(start).max(), np.abs(start + self.way_mm * self.along).max())
        return float(np.ceil(max(farthest + self.cap_mm / 2.0, 4.0)))


CASES = {
    "middle": Drag(0.5, 6.0, 8.0, 0.0, 0.0, 1.5, 3.0, 0.0),
    "slippery": Drag(0.2, 6.0, 7.0, -3.0, 0.0, 1.2, 4.0, 0.0),
    "rough": Drag(0.8, 6.0, 7.0, -3.0, 1.0, 1.2, 4.0, 0.2),
    "small": Drag(0.35, 3.0, 4.4, 2.0, -2.0, 1.0, 4.0, 2.2),
    "wide": Drag(0.6, 20.0, 9.0, -2.0, -2.0, 0.8, 3.5, 0.8),
    "roughest": Drag(1.2, 10.0, 8.0, 0.0, 0.0, 1.0, 3.0, 0.8),
    "outside": Drag(0.8, 4.0, 5.5, 4.0, 3.0, 1.3, 4.0, 3.4),
    "flat": Drag(0.5, 3.0, 13.0, -1.5, 0.0, 0.8, 3.0, 0.3, flat_mm=4.0),
}


def mesh_of(slab: Slab, drag: Drag, fine_mm: float = FINE_MM) -> SlabMesh:
    """Elements of fine_mm where the ball passes; coarse ones beyond."""
    radius, span, half = (
        MM * along for along in (slab.magnet_diameter_m / 2, slab.width_m / 2 - slab.rim_m, slab.width_m / 2)
    )
    edges = (
        (0.0, radius, fine_mm),
        (radius, drag.reach_mm, fine_mm),
        (drag.reach_mm, span, COARSE_MM),
        (span, half, half),
    )
    side = np.concatenate([np.linspace(a, b, max(round((b - a) / step), 1) + 1) for a, b, step in edges])
    line = np.unique(np.round(np.concatenate([-side, side]), 9))
    return SlabMesh.on_lines(slab, fine_mm / MM, line, np.array(HEIGHTS_MM))


def ball_of(drag: Drag, top_mm: float) -> tuple[Array, NDArray[np.intp]]:
    """Points and cells of one layer of hexahedra whose lower face is the ball's."""
    count, half = round(drag.cap_mm / BALL_ELEMENT_MM) + 1, drag.cap_mm / 2.0
    u, v = np.meshgrid(np.linspace(-1.0, 1.0, count), np.linspace(-1.0, 1.0, count), indexing="ij")
    x, y = half * u * np.sqrt(1.0 - v * v / 2.0), half * v * np.sqrt(1.0 - u * u / 2.0)  # a square becomes a disc
    rise = drag.ball_mm - np.sqrt(drag.ball_mm**2 - np.maximum(np.hypot(x, y) - drag.flat_mm, 0.0) ** 2)
    low = np.stack([x + drag.x_mm, y + drag.y_mm, rise + top_mm + GAP_MM], axis=-1).reshape(-1, 3)
    high = low.copy()
    high[:, 2] = top_mm + drag.cap_mm
    index = np.arange(count * count).reshape(count, count)
    corner = [index[i : i - 1 or None, j : j - 1 or None].ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    face = np.stack(corner, axis=1)
    return np.concatenate([low, high]), np.hstack([face, face + count * count])


def top_cells(mesh: SlabMesh, drag: Drag) -> NDArray[np.intp]:
    """The silicone's cells on the top that the ball may touch."""
    centre = mesh.points_mm[mesh.cells].mean(axis=1)
    is_top = np.isclose(mesh.points_mm[mesh.cells[:, 4], 2], mesh.height_mm[-1])
    middle = np.array([drag.x_mm, drag.y_mm]) + drag.way_mm / 2.0 * drag.along
    near = np.all(np.abs(centre[:, :2] - middle) < drag.way_mm / 2.0 + drag.cap_mm / 2.0 + 3.0, axis=1)
    return np.flatnonzero(is_top & near)


def deck(slab: Slab, mesh: SlabMesh, drag: Drag) -> str:
    """CalculiX's input in mm, N, MPa. Points and cells count from one; the ball's follow the slab's."""
    points, cells = ball_of(drag, float(mesh.height_mm[-1]))
    first_point, first_cell = len(mesh.points_mm), len(mesh.cells)
    held, turned = first_point + len(points) + 1, first_point + len(points) + 2
    holder = f"{drag.x_mm:.9g}, {drag.y_mm:.9g}, {mesh.height_mm[-1] + drag.cap_mm:.9g}"
    top = top_cells(mesh, drag)
    everything = np.concatenate([mesh.points_mm, points])
    energy = f"{slab.c10_pa * MPA:.9g}, {slab.c01_pa * MPA:.9g}, {2.0 / (slab.bulk_pa * MPA):.9g}"
    lines = [
        "*NODE",
        *(f"{i}, {x:.9g}, {y:.9g}, {z:.9g}" for i, (x, y, z) in enumerate(everything, 1)),
        *(f"{held}, {holder}", f"{turned}, {holder}"),
        *_elements("SILICONE", "C3D8I", np.flatnonzero(~mesh.magnet_cells), mesh.cells),
        *_elements("MAGNET", "C3D8I", np.flatnonzero(mesh.magnet_cells), mesh.cells),
        *_elements(
            "BALL", "C3D8", np.arange(len(cells)) + first_cell, np.concatenate([mesh.cells, cells + first_point])
        ),
        *point_set("FIXED", np.flatnonzero(mesh.fixed_points)),
        *point_set("SHOWN", shown_points(mesh, drag)),
        *("*NSET, NSET=BALLPOINTS, GENERATE", f"{first_point + 1}, {first_point + len(points)}"),
        *("*SURFACE, NAME=TOP, TYPE=ELEMENT", *(f"{cell + 1}, S2" for cell in top)),
        *("*SURFACE, NAME=FACE, TYPE=ELEMENT", *(f"{first_cell + i + 1}, S1" for i in range(len(cells)))),
        f"*RIGID BODY, NSET=BALLPOINTS, REF NODE={held}, ROT NODE={turned}",
        *("*MATERIAL, NAME=PDMS", "*HYPERELASTIC, MOONEY-RIVLIN", energy),
        *("*MATERIAL, NAME=STIFF", "*ELASTIC", f"{3.0 * slab.shear_modulus_pa * MPA * MAGNET_STIFFNESS:.9g}, 0.3"),
        *("*SOLID SECTION, ELSET=SILICONE, MATERIAL=PDMS", "*SOLID SECTION, ELSET=MAGNET, MATERIAL=STIFF"),
        *("*SOLID SECTION, ELSET=BALL, MATERIAL=STIFF", "*SURFACE INTERACTION, NAME=RUB"),
        *("*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{NORMAL_MPA_PER_MM}, 0.0, 0.001"),
        *("*FRICTION", f"{drag.friction}, {STICK_MPA_PER_MM}"),
        *("*CONTACT PAIR, INTERACTION=RUB, TYPE=SURFACE TO SURFACE", "TOP, FACE", "*BOUNDARY", "FIXED, 1, 3"),
    ]
    for way_mm, increments in ((0.0, PRESSING), (drag.way_mm, DRAGGING)):
        x_mm, y_mm = way_mm * drag.along
        step = 1.0 / increments
        lines += [
            *("*STEP, NLGEOM, INC=2000", "*STATIC", f"{step}, 1.0, 1e-6, {step}", "*BOUNDARY"),
            *(f"{held}, {axis}, {axis}, {by:.9g}" for axis, by in ((1, x_mm), (2, y_mm), (3, -drag.depth_mm))),
            *(f"{turned}, 1, 3, 0.0", "*NODE PRINT, NSET=SHOWN", "U", "*NODE PRINT, NSET=FIXED, TOTALS=ONLY", "RF"),
            "*END STEP",
        ]
    return "\n".join(lines) + "\n"


def shown_points(mesh: SlabMesh, drag: Drag) -> NDArray[np.intp]:
    """The points of the magnet, and of the face that the ball may touch."""
    touched = mesh.cells[top_cells(mesh, drag)][:, 4:]
    return np.unique(np.concatenate([mesh.cells[mesh.magnet_cells].ravel(), touched.ravel()]))


def _elements(name: str, kind: str, chosen: NDArray[np.intp], cells: NDArray[np.intp]) -> Iterator[str]:
    yield f"*ELEMENT, TYPE={kind}, ELSET={name}"
    yield from (
        ", ".join(str(number) for number in (cell + 1, *(cells[cell] + 1).tolist())) for cell in chosen.tolist()
    )


def solve(name: str, drag: Drag, fine_mm: float = FINE_MM) -> list[list[str]]:
    """Rows of the drag, from the first touch on. RuntimeError with CalculiX's last output if it failed."""
    slab = Slab()
    mesh = mesh_of(slab, drag, fine_mm)
    with TemporaryDirectory() as folder:
        Path(folder, "drag.inp").write_text(deck(slab, mesh, drag))
        said = subprocess.run(["ccx", "drag"], cwd=folder, capture_output=True, text=True, check=False).stdout
        result = Path(folder, "drag.dat")
        text = result.read_text() if result.exists() else ""
    rows = [_row(name, drag, mesh, block) for block in re.split(r"\n(?= displacements)", text)[1:]]
    if not rows or float(rows[-1][3]) < drag.way_mm - 1e-6:
        raise RuntimeError(f"CalculiX gave up after {len(rows)} increments: {said[-500:]}")
    return rows


def _row(name: str, drag: Drag, mesh: SlabMesh, block: str) -> list[str]:
    head, _, tail = block.partition("total force")
    time = float(head.splitlines()[0].split()[-1])
    table = np.array([[float(cell) for cell in line.split()] for line in head.splitlines()[1:] if line.strip()])
    moved = np.zeros_like(mesh.points_mm)
    moved[table[:, 0].astype(int) - 1] = table[:, 1:]
    displacement_m, axis = mesh.magnet_pose(moved)
    shear_x, shear_y, force = (-float(cell) for cell in tail.splitlines()[2].split())
    way_mm = max(time - 1.0, 0.0) * drag.way_mm
    place = place_under(mesh, drag, moved, way_mm)
    numbers = (way_mm, *place, -force, shear_x, shear_y, *(displacement_m * 1e6), *axis[:2])
    return [name, f"{drag.friction:g}", f"{drag.ball_mm:g}", *(f"{number:.6g}" for number in numbers)]


def place_under(mesh: SlabMesh, drag: Drag, moved_mm: Array, way_mm: float) -> Array:
    """The place (2,) on the undeformed top that is under the ball's lowest point: it stays while the ball sticks."""
    points = np.unique(mesh.cells[top_cells(mesh, drag)][:, 4:])
    before = mesh.points_mm[points, :2]
    lowest = np.array([drag.x_mm, drag.y_mm]) + way_mm * drag.along
    away = before + moved_mm[points, :2] - lowest
    nearest = np.argsort(np.sum(away * away, axis=1))[:9]
    # A plane through the nine nearest points gives the place as a linear function of their present positions.
    now = np.column_stack([away[nearest], np.ones(len(nearest))])
    return np.asarray(np.linalg.lstsq(now, before[nearest], rcond=None)[0][2])


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m fmfts_lab.finite_elements.drags")
    parser.add_argument("output", type=Path)
    parser.add_argument("--case", choices=CASES, action="append")
    parser.add_argument("--element-mm", type=float, default=FINE_MM, help="where the ball passes")
    options = parser.parse_args(arguments)
    rows = list(csv.reader(options.output.read_text().splitlines()))[1:] if options.output.exists() else []
    for name in options.case or CASES:
        if any(row[0] == name for row in rows):
            continue
        rows += solve(name, CASES[name], options.element_mm)
        with options.output.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
        print(f"{name}: {rows[-1]}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
