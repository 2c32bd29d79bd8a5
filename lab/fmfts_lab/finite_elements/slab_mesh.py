"""A mesh of hexahedra for a slab with magnets inside: straight grid lines, bent round each magnet. In mm."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array
from fmfts_lab.finite_elements.slab import Press, Slab

MM = 1e3
# The memory for the factorised stiffness grows with the square of the points: 0.67 mm (21,600 points) needs over 6 GB.
MOST_POINTS = 25_000


@dataclass(frozen=True, slots=True)
class SlabMesh:
    """P points (x slowest, z fastest), C cells of eight points, and the grid lines in the plane and in height.

    magnet_cells (C,): those of any magnet. magnet_of (C,): whose, from 0; −1 for silicone.
    """

    points_mm: Array
    cells: NDArray[np.intp]
    line_mm: Array
    height_mm: Array
    magnet_of: NDArray[np.intp]
    fixed_points: NDArray[np.bool_]

    @classmethod
    def of(cls, slab: Slab, element_m: float) -> SlabMesh:
        """Elements of about `element_m`. The magnet's faces and the rim's edge lie on grid lines."""
        radius, half_width = MM * slab.magnet_diameter_m / 2.0, MM * slab.width_m / 2.0
        span = half_width - MM * slab.rim_m
        bottom, top = (MM * (slab.magnet_height_m + sign * slab.magnet_length_m / 2.0) for sign in (-1, 1))
        edges = {
            along + side for place in MM * np.array(slab.magnets_m) for along in place for side in (-radius, radius)
        }
        line = _divided(sorted({-half_width, -span, span, half_width} | edges), MM * element_m)
        height = _divided([0.0, bottom, top, MM * slab.thickness_m], MM * element_m)
        return cls.on_lines(slab, element_m, line, height)

    @classmethod
    def on_lines(cls, slab: Slab, element_m: float, line: Array, height: Array) -> SlabMesh:
        """Grid lines in mm, which hold the magnet's faces and the rim's edge. element_m: for the message only."""
        radius, span = MM * slab.magnet_diameter_m / 2.0, MM * (slab.width_m / 2.0 - slab.rim_m)
        bottom, top = (MM * (slab.magnet_height_m + sign * slab.magnet_length_m / 2.0) for sign in (-1, 1))
        points_asked = len(line) ** 2 * len(height)
        if points_asked > MOST_POINTS:
            raise ValueError(
                f"elements of {MM * element_m:g} mm make {points_asked} points; more than {MOST_POINTS} need more "
                "memory than a computer has: take larger ones (--element-mm)"
            )
        x, y, z = np.meshgrid(line, line, height, indexing="ij")
        points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        index = np.arange(x.size).reshape(x.shape)
        corner = [
            index[i : i - 1 or None, j : j - 1 or None, k : k - 1 or None].ravel()
            for k in (0, 1)
            for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))
        ]
        cells = np.stack(corner, axis=1)
        centre = points[cells].mean(axis=1)
        within = (centre[:, 2] > bottom) & (centre[:, 2] < top)
        magnet = np.full(len(cells), -1)
        for number, place in enumerate(MM * np.array(slab.magnets_m)):
            magnet[within & np.all(np.abs(centre[:, :2] - place) < radius, axis=1)] = number
        fixed = (points[:, 2] == 0.0) & np.any(np.abs(points[:, :2]) >= span - 1e-9, axis=1)

        whole = np.interp(points[:, 2], [0.0, bottom, top, MM * slab.thickness_m], [0.0, 1.0, 1.0, 0.0])
        for place in MM * np.array(slab.magnets_m):
            away = points[:, :2] - place
            near = np.all(np.abs(away) <= 2.0 * radius + 1e-9, axis=1)
            points[near, :2] += whole[near, None] * (_rounded(away[near], radius, line - place[0]) - away[near])
        return cls(points, cells, line, height, magnet, fixed)

    @property
    def magnet_cells(self) -> NDArray[np.bool_]:
        return np.asarray(self.magnet_of >= 0)

    def load(self, slab: Slab, press: Press) -> Array:
        """Nodal forces (P, 3) in N of a traction spread evenly over the patch on the undeformed top face."""
        share = self.top_face_shares(MM * slab.patch_points(press.x_m, press.y_m))
        force = np.array([press.shear_x_n, press.shear_y_n, -press.force_n])
        load = np.zeros_like(self.points_mm)
        load[self._top()] = share[:, None] * force
        return load

    def top_face_shares(self, place_mm: Array) -> Array:
        """(T,) the share of each point of the top face in a unit load spread equally over `place_mm` (Q, 2)."""
        count = len(self.line_mm)
        cell = np.clip(np.searchsorted(self.line_mm, place_mm, side="right") - 1, 0, count - 2)
        along = (place_mm - self.line_mm[cell]) / np.diff(self.line_mm)[cell]
        share = np.zeros((count, count))
        for i in (0, 1):
            for j in (0, 1):
                weight = np.abs(1 - i - along[:, 0]) * np.abs(1 - j - along[:, 1])
                np.add.at(share, (cell[:, 0] + i, cell[:, 1] + j), weight / len(place_mm))
        return share.ravel()

    def on_top(self, values: Array) -> Array:
        """The `values` (P, …) at the points of the top face, (X, X, …)."""
        count = len(self.line_mm)
        return values[self._top()].reshape(count, count, *values.shape[1:])

    def magnet_pose(self, displacement_mm: Array, magnet: int = 0) -> tuple[Array, Array]:
        """Displacement (3,) in m of a magnet's centre, and its unit axis (3,): the nearest rigid motion."""
        points = np.unique(self.cells[self.magnet_of == magnet])
        before, moved = self.points_mm[points], displacement_mm[points]
        centred, after = before - before.mean(axis=0), before + moved
        left, _, right = np.linalg.svd(centred.T @ (after - after.mean(axis=0)))
        rotation = (left @ right).T
        return moved.mean(axis=0) / MM, rotation[:, 2]

    def _top(self) -> NDArray[np.bool_]:
        top: NDArray[np.bool_] = np.tile(self.height_mm == self.height_mm[-1], len(self.line_mm) ** 2)
        return top


def _divided(edges: list[float], longest: float) -> Array:
    """Grid lines at all `edges`, with evenly spaced lines between them where the gap is longer than `longest`."""
    parts = []
    for start, end in pairwise(edges):
        parts.append(np.linspace(start, end, max(round((end - start) / longest), 1), endpoint=False))
    return np.append(np.concatenate(parts), edges[-1])


def _rounded(place: Array, radius: float, line: Array) -> Array:
    """Moves `place` (P, 2): squares around the centre become circles at the magnet, and stay squares at two radii.

    The polygon that represents the magnet's circle gets the circle's area.
    """
    reach = np.max(np.abs(place), axis=1)
    distance = np.maximum(np.hypot(place[:, 0], place[:, 1]), 1e-12)
    side = line[np.abs(line) <= radius + 1e-9]
    angle = np.diff(np.arctan2(side, radius))
    area = 4.0 * radius**2 * np.sum(np.sin(angle)) / 2.0
    scale = radius * np.sqrt(np.pi / area)
    circular = np.interp(reach / radius, [0.0, 1.0, 2.0], [1.0, 1.0, 0.0])[:, None]
    circle = place * (reach * scale / radius / distance)[:, None]
    rounded: Array = place + circular * (circle - place)
    return rounded
