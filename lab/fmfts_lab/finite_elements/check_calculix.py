"""Solves one press again with CalculiX (Debian: calculix-ccx), which shares no code with felupe, and compares.

python -m fmfts_lab.finite_elements.check_calculix [--x-mm 8] [--y-mm 6] [--force-n 1] [--element-mm 1]

Same lines, energy and load; elements C3D20R (quadratic, reduced integration) instead of Q1P0.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fmfts.pad import Array
from fmfts_lab.finite_elements.finite_element import MAGNET_STIFFNESS, MPA, PressedSlab
from fmfts_lab.finite_elements.slab import Press, Slab
from fmfts_lab.finite_elements.slab_mesh import MM, SlabMesh

JOB = "press"
LEVELS = (0.25, 0.5, 0.75, 1.0)  # of its load
EDGES = np.array(
    [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]], dtype=np.intp
)
TOP_FACE = np.array([4, 5, 6, 7, 12, 13, 14, 15])
CORNERS, AMID = ((-1, -1), (1, -1), (1, 1), (-1, 1)), ((0, -1), (1, 0), (0, 1), (-1, 0))


def deck(slab: Slab, mesh: SlabMesh, press: Press) -> str:
    """CalculiX's input in mm, N, MPa. Points and cells count from one."""
    points, cells = quadratic(mesh)
    load = patch_load(slab, mesh, points, cells, press)
    fixed = (points[:, 2] == 0.0) & np.any(
        np.abs(points[:, :2]) >= MM * (slab.width_m / 2.0 - slab.rim_m) - 1e-9, axis=1
    )
    # CalculiX writes W = C10 (Ī1 − 3) + C01 (Ī2 − 3) + (J − 1)²/D1.
    energy = f"{slab.c10_pa * MPA:.9g}, {slab.c01_pa * MPA:.9g}, {2.0 / (slab.bulk_pa * MPA):.9g}"
    magnet_mpa = 3.0 * slab.shear_modulus_pa * MPA * MAGNET_STIFFNESS
    lines = [
        "*NODE",
        *(f"{i}, {x:.9g}, {y:.9g}, {z:.9g}" for i, (x, y, z) in enumerate(points, 1)),
        *_elements("SILICONE", cells, ~mesh.magnet_cells),
        *_elements("MAGNET", cells, mesh.magnet_cells),
        *point_set("FIXED", np.flatnonzero(fixed)),
        *point_set("INCLUSION", np.unique(mesh.cells[mesh.magnet_cells])),
        *("*MATERIAL, NAME=PDMS", "*HYPERELASTIC, MOONEY-RIVLIN", energy),
        *("*MATERIAL, NAME=STIFF", "*ELASTIC", f"{magnet_mpa:.9g}, 0.3"),
        *("*SOLID SECTION, ELSET=SILICONE, MATERIAL=PDMS", "*SOLID SECTION, ELSET=MAGNET, MATERIAL=STIFF"),
        *("*BOUNDARY", "FIXED, 1, 3"),
        *("*TIME POINTS, NAME=LEVELS", ", ".join(str(level) for level in LEVELS)),
        *("*STEP, NLGEOM, INC=100", "*STATIC", "0.25, 1.0", "*CLOAD"),
        *(f"{i + 1}, {axis + 1}, {load[i, axis]:.9g}" for i, axis in np.argwhere(load != 0.0).tolist()),
        *("*NODE PRINT, NSET=INCLUSION, TIME POINTS=LEVELS", "U", "*END STEP"),
    ]
    return "\n".join(lines) + "\n"


def quadratic(mesh: SlabMesh) -> tuple[Array, np.ndarray]:
    """Points (P, 3), the mesh's own and then the middles of edges, and cells (C, 20) in CalculiX's order."""
    edges = mesh.cells[:, EDGES]
    each, number = np.unique(np.sort(edges.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    points = np.concatenate([mesh.points_mm, mesh.points_mm[each].mean(axis=1)])
    return points, np.hstack([mesh.cells, len(mesh.points_mm) + number.reshape(len(edges), -1)])


def patch_load(slab: Slab, mesh: SlabMesh, points: Array, cells: np.ndarray, press: Press) -> Array:
    """Nodal forces (P, 3) in N, by the shape functions of the quadratic faces on the top."""
    faces = cells[:, TOP_FACE]
    faces = faces[np.all(points[faces, 2] == mesh.height_mm[-1], axis=1)]
    low, high = points[faces].min(axis=1)[:, :2], points[faces].max(axis=1)[:, :2]
    load = np.zeros_like(points)
    places = MM * slab.patch_points(press.x_m, press.y_m)
    force = np.array([press.shear_x_n, press.shear_y_n, -press.force_n]) / len(places)
    for place in places:
        (on,) = np.flatnonzero(np.all((low <= place) & (place < high), axis=1))
        r, s = 2.0 * (place - low[on]) / (high[on] - low[on]) - 1.0
        corner = [(1 + r * i) * (1 + s * j) * (r * i + s * j - 1) / 4 for i, j in CORNERS]
        amid = [(1 - r * r) * (1 + s * j) / 2 if i == 0 else (1 + r * i) * (1 - s * s) / 2 for i, j in AMID]
        load[faces[on]] += np.array(corner + amid)[:, None] * force
    return load


def _elements(name: str, cells: np.ndarray, chosen: np.ndarray) -> Iterator[str]:
    yield f"*ELEMENT, TYPE=C3D20R, ELSET={name}"
    for i in np.flatnonzero(chosen):
        numbers = [str(number) for number in (i + 1, *(cells[i] + 1).tolist())]
        yield from (", ".join(numbers[:11]) + ",", ", ".join(numbers[11:]))


def point_set(name: str, points: Iterable[int]) -> Iterator[str]:
    yield f"*NSET, NSET={name}"
    yield from (f"{i + 1}," for i in points)


def solved(slab: Slab, mesh: SlabMesh, press: Press) -> tuple[Array, Array]:
    """The magnet's displacement (3,) in m and axis (3,). RuntimeError with CalculiX's last output if it failed."""
    return solved_ramp(slab, mesh, press)[-1]


def solved_ramp(slab: Slab, mesh: SlabMesh, press: Press) -> list[tuple[Array, Array]]:
    """The same at each of LEVELS, shares of the press."""
    with TemporaryDirectory() as folder:
        Path(folder, f"{JOB}.inp").write_text(deck(slab, mesh, press))
        said = subprocess.run(["ccx", JOB], cwd=folder, capture_output=True, text=True, check=False).stdout
        result = Path(folder, f"{JOB}.dat")
        text = result.read_text() if result.exists() else ""
    blocks = text.split("displacements (vx,vy,vz)")
    if len(blocks) < 1 + len(LEVELS):
        raise RuntimeError(f"CalculiX gave up: {said[-500:]}")
    return [_pose(block, mesh) for block in blocks[1:]]


def _pose(block: str, mesh: SlabMesh) -> tuple[Array, Array]:
    rows = np.array([[float(cell) for cell in line.split()] for line in block.splitlines()[1:] if line.strip()])
    displacement_mm = np.zeros_like(mesh.points_mm)
    displacement_mm[rows[:, 0].astype(int) - 1] = rows[:, 1:]
    return mesh.magnet_pose(displacement_mm)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m fmfts_lab.finite_elements.check_calculix")
    for name, default in (("x-mm", 8.0), ("y-mm", 6.0), ("force-n", 1.0), ("element-mm", 1.0)):
        parser.add_argument(f"--{name}", type=float, default=default)
    options = parser.parse_args(arguments)
    press, slab = Press(options.x_mm * 1e-3, options.y_mm * 1e-3, options.force_n), Slab()
    pressed = PressedSlab(slab, options.element_mm * 1e-3)
    poses = {"felupe": pressed.solve(press), "CalculiX": solved(slab, pressed.mesh, press)}
    for name, (displacement_m, axis) in poses.items():
        print(f"{name:9} {np.round(displacement_m * 1e6, 3)} µm, axis {np.round(axis[:2], 6)}")
    (ours_m, our_axis), (theirs_m, their_axis) = poses.values()
    way = np.linalg.norm(ours_m - theirs_m) / np.linalg.norm(theirs_m)
    tilt = np.linalg.norm(our_axis - their_axis)
    print(f"they differ by {way:.3%} of the way, and by {tilt * 1e3:.3f} mrad")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
