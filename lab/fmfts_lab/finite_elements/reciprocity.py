"""Computes how any light load on the surface moves the magnet, from the effect of loads on the magnet on the surface.

Maxwell–Betti: in a linear solid, load A does the same work on the displacement of load B as B on that of A. So five
solutions (three unit forces and two unit couples on the magnet) give the magnet's displacement and tilt under every
distribution of force on the top face. It holds for small strains; lab/README.md says how far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fmfts.pad import Array
from fmfts_lab.finite_elements.finite_element import PressedSlab
from fmfts_lab.finite_elements.slab import ELEMENT_M, Slab
from fmfts_lab.finite_elements.slab_mesh import MM, SlabMesh
from fmfts_simulation.mechanics import Mechanics

TABLE_SPACING_M = 1e-3
LINEAR = np.eye(3, dtype=np.intp)  # powers of (F, Ft_x, Ft_y)
SI = np.array([1.0 / MM, 1.0 / MM, 1.0 / MM, 1.0, 1.0])


@dataclass(frozen=True, slots=True)
class Influence:
    """response (T, 3, 5): movement of the first magnet by 1 N along x, y, z at each point of the top face: displacement
    in m, and x and y of the unit axis."""

    slab: Slab
    mesh: SlabMesh
    response: Array

    @classmethod
    def of(
        cls, slab: Slab, element_m: float = ELEMENT_M, show: Callable[[float], None] = lambda share: None
    ) -> Influence:
        """`show` is called with the share that is done."""
        pressed = PressedSlab(slab, element_m)
        surface = []
        for done, load in enumerate(magnet_loads(pressed.mesh)):
            show((done + 1) / 6)
            surface.append(pressed.mesh.on_top(pressed.linear(load)).reshape(-1, 3))
        return cls(slab, pressed.mesh, np.stack(surface, axis=-1) * SI)

    def of_patch(self, x_m: float, y_m: float) -> Array:
        """(3, 5) movement by 1 N along x, y, z, spread evenly over the patch around (x, y)."""
        share = self.mesh.top_face_shares(MM * self.slab.patch_points(x_m, y_m))
        return np.asarray(np.tensordot(share, self.response, axes=1), dtype=np.float64)

    def mechanics(self) -> Mechanics:
        """The table for patches within the rim. It is linear, so it has no largest force."""
        reach_m = self.slab.reach_m
        grid_m = np.linspace(-reach_m, reach_m, 2 * max(round(reach_m / TABLE_SPACING_M), 2) + 1)
        per_newton = np.array([[self.of_patch(x, y) for y in grid_m.tolist()] for x in grid_m.tolist()])
        pressed = np.concatenate([-per_newton[:, :, 2:], per_newton[:, :, :2]], axis=2)
        return Mechanics.from_terms(grid_m, np.inf, LINEAR, pressed)


def magnet_loads(mesh: SlabMesh, magnet: int = 0) -> Array:
    """(5, P, 3) nodal forces whose work is a magnet's displacement along x, y, z and the turn of its axis to x and y.

    They are `SlabMesh.magnet_pose` linearised: the mean, and the rotation with the least squares.
    """
    points = np.unique(mesh.cells[mesh.magnet_of == magnet])
    arm = mesh.points_mm[points] - mesh.points_mm[points].mean(axis=0)
    inertia = np.sum(arm**2) * np.eye(3) - arm.T @ arm
    loads = np.zeros((5, *mesh.points_mm.shape))
    for i in range(3):
        loads[i, points, i] = 1.0 / len(points)
    towards_x, towards_y = np.linalg.solve(inertia, np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]).T).T
    loads[3, points] = np.cross(towards_x, arm)
    loads[4, points] = np.cross(towards_y, arm)
    return loads
