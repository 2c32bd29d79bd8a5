"""A table of presses as a correction of another one: few numbers, in steps from the fewest to the most.

1. "force": one factor. A softer silicone moves as far under less force.
2. "shape": a factor for movements sideways, downwards and for tilts, and one for the width of the response: thickness.
3. "places": where each magnet is in the table, along x and y: how it was cast.
4. "map": an addition to each number of pose, in proportion to the force, that varies smoothly over the pad and has the
   pad's own symmetries: everything else that a structure does.

The corrected change of magnet m under a press at r with force F is, of the table T (terms T_t of F^t), with
r' = r_m + (r − r_m)e^(−w) − δ_m:

    c_m(r, F) = Σ_t e^(b + a·t) T_t(r') F^t + Σ_k θ_k D_k(r) F
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.spline import cover, spline_collocation
from fmfts.contact.array_response import CHANGE, ArrayResponse
from fmfts.pad import Array

LEVELS = ("force", "shape", "places", "map")
KINDS = np.array([0, 0, 1, 2, 2])  # sideways, down, tilt
# Deviations of the correction before any press is known. A map's are shares of the table's mean movement.
FORCE, KIND, WIDTH, SHEAR, MAP = 0.4, 0.2, 0.1, 0.3, 0.1
PLACE_MM = 0.3
CELLS = 5  # cells of the map along x and along y
SCALARS = 6  # log factors: force, three kinds, width, shear
SAME_MM = 0.5  # largest distance at which a symmetry maps one magnet onto another


@dataclass(frozen=True)
class Correction:
    """Corrections of `start`. centre_mm (M, 2): the drawing's places of the magnets. basis (B², 5M, D): the directions
    of the map. kind, width: deviations of those factors before any press is known."""

    start: ArrayResponse
    centre_mm: Array
    basis: Array
    kind: float = KIND
    width: float = WIDTH

    @classmethod
    def of(cls, start: ArrayResponse, centre_mm: Array, kind: float = KIND, width: float = WIDTH) -> Correction:
        return cls(start, centre_mm, _symmetric(centre_mm), kind, width)

    @property
    def none(self) -> Array:
        """The parameters of no correction: scalars, places (2M), map (D)."""
        return np.zeros(SCALARS + 2 * len(self.centre_mm) + self.basis.shape[2])

    def free(self, level: str, sheared: bool) -> NDArray[np.bool_]:
        """(U,) which parameters a level may change."""
        free, step = np.zeros(len(self.none), dtype=np.bool_), LEVELS.index(level)
        places = SCALARS + 2 * len(self.centre_mm)
        free[0], free[5] = True, sheared
        free[1:5] = step >= 1
        free[SCALARS:places] = step >= 2
        free[places:] = step >= 3
        return free

    @property
    def deviation(self) -> Array:
        """The deviations (U,) of the parameters before any press is known."""
        magnets = len(self.centre_mm)
        first = self.start.coefficient[1:-1, 1:-1, 0].reshape(-1, magnets, CHANGE)
        mean = np.tile(np.sqrt(np.square(first).mean(axis=(0, 1))), magnets)
        weight = np.square(self.basis).sum(axis=0)
        of_map = MAP * (weight * mean[:, None]).sum(axis=0) / weight.sum(axis=0)
        scalars = [FORCE, self.kind, self.kind, self.kind, self.width, SHEAR]
        return np.concatenate([scalars, np.full(2 * magnets, PLACE_MM), of_map])

    def presses(self, theta: Array, press: Array, off_mm: Array, of_map: Array) -> tuple[Array, Array, Array]:
        """The effect of presses (K, 5): change (K, 5M) in the table's units; its slope (K, 5M, U) by the parameters,
        and by x, y and the force (K, 5M, 3). off_mm (M, 2): how far each magnet rests from its drawn place, to first
        order, as in the running pad. of_map: `map_at` of the presses."""
        magnets, force = len(self.centre_mm), press[:, 2]
        of_force, shear_factor = np.exp(theta[0]), np.exp(theta[0] + theta[5])
        factor, narrow = np.exp(theta[1:4])[KINDS], np.exp(-theta[4])
        load = force * of_force
        change = np.zeros((len(press), magnets, CHANGE))
        slope = np.zeros((len(press), magnets, CHANGE, len(theta)))
        by_press = np.zeros((len(press), magnets, CHANGE, 3))
        for number, (centre, off) in enumerate(zip(self.centre_mm, off_mm, strict=True)):
            own = slice(CHANGE * number, CHANGE * (number + 1))
            place = theta[SCALARS + 2 * number : SCALARS + 2 * number + 2]
            away = (press[:, :2] - centre) * narrow
            at = centre + away - place
            value, along_x, along_y = _table(self.start, at, own)
            power, by_load = _powers(self.start, load)
            shear = np.einsum("kap,ka->kp", value[:, -2:], press[:, 3:]) * shear_factor
            terms = slice(0, -2)
            pure = np.einsum("ktp,kt->kp", value[:, terms], power) * factor
            sides = np.stack([np.einsum("ktp,kt->kp", each[:, terms], power) * factor for each in (along_x, along_y)])
            by_force = np.einsum("ktp,kt->kp", value[:, terms], by_load) * factor
            moved = sides[0] * off[0] + sides[1] * off[1]
            change[:, number] = pure + shear - narrow * moved
            # The running pad ignores shear in a magnet's offset from its place.
            sides = sides + np.stack(
                [np.einsum("kap,ka->kp", each[:, -2:], press[:, 3:]) * shear_factor for each in (along_x, along_y)]
            )
            slope[:, number, :, 0] = by_force * load[:, None] + shear
            for kind in range(3):
                slope[:, number, :, 1 + kind] = (pure - narrow * moved) * (kind == KINDS)
            slope[:, number, :, 4] = -(sides[0] * away[:, :1] + sides[1] * away[:, 1:])
            slope[:, number, :, 5] = shear
            slope[:, number, :, SCALARS + 2 * number] = -sides[0]
            slope[:, number, :, SCALARS + 2 * number + 1] = -sides[1]
            by_press[:, number, :, 0], by_press[:, number, :, 1] = narrow * sides[0], narrow * sides[1]
            by_press[:, number, :, 2] = by_force * of_force
        flat = slope.reshape(len(press), CHANGE * magnets, -1)
        first = SCALARS + 2 * magnets
        flat[:, :, first:] = of_map * force[:, None, None]
        by_map = np.einsum("kpd,d->kp", of_map, theta[first:])
        whole = change.reshape(len(press), -1) + by_map * force[:, None]
        every = by_press.reshape(len(press), -1, 3)
        every[:, :, 2] += by_map
        return whole, flat, every

    def table(self, theta: Array, error: float) -> ArrayResponse:
        """The corrected table; error: its own, relative."""
        start, magnets = self.start, len(self.centre_mm)
        knots = start.first_mm + start.spacing_mm * np.arange(len(start.coefficient) - 2)
        grid = np.array([[x, y] for x in knots for y in knots])
        terms = start.coefficient.shape[2]
        factor, narrow = np.exp(theta[1:4])[KINDS], np.exp(-theta[4])
        per_force = np.exp(theta[0] * np.arange(1, terms + 1))
        values = np.empty((len(grid), terms + 2, CHANGE * magnets))
        for number, centre in enumerate(self.centre_mm):
            own = slice(CHANGE * number, CHANGE * (number + 1))
            place = theta[SCALARS + 2 * number : SCALARS + 2 * number + 2]
            value, _, _ = _table(start, centre + (grid - centre) * narrow - place, own)
            values[:, :terms, own] = value[:, :terms] * per_force[:, None] * factor
            values[:, terms:, own] = value[:, terms:] * np.exp(theta[0] + theta[5])
        first = SCALARS + 2 * magnets
        values[:, 0] += np.einsum("kpd,d->kp", self.map_at(grid, np.zeros_like(self.centre_mm)), theta[first:])
        spline = np.linalg.inv(spline_collocation(len(knots)))[:, 1:-1]
        shaped = values.reshape(len(knots), len(knots), terms + 2, -1)
        coefficient = np.einsum("ai,bj,ijtp->abtp", spline, spline, shaped, optimize=True)
        return replace(
            start,
            scale_n=float(start.scale_n * np.exp(-theta[0])),
            coefficient=coefficient[:, :, :terms],
            shear=coefficient[:, :, terms:],
            error=error,
        )

    def map_at(self, place_mm: Array, off_mm: Array) -> Array:
        """The map (K, 5M, D) in each direction at places (K, 2), for magnets `off_mm` beside their drawn places."""
        first, last = self.start.first_mm, self.start.last_mm
        spacing = (last - first) / CELLS
        x, x1 = _basis(place_mm[:, 0], first, spacing, CELLS)
        y, y1 = _basis(place_mm[:, 1], first, spacing, CELLS)
        both = [
            (left[:, :, None] * right[:, None]).reshape(len(place_mm), -1) for left, right in ((x, y), (x1, y), (x, y1))
        ]
        value, along_x, along_y = (np.tensordot(each, self.basis, axes=1) for each in both)
        off_x, off_y = (np.repeat(off_mm[:, axis], CHANGE)[:, None] for axis in (0, 1))
        moved: Array = value - along_x * off_x - along_y * off_y
        return moved


def _powers(table: ArrayResponse, load_n: Array) -> tuple[Array, Array]:
    """(K, T) powers of the load, and their slopes; beyond the table's largest force they follow their tangents."""
    inside = np.minimum(load_n, table.scale_n)[:, None]
    number = np.arange(1, table.coefficient.shape[2] + 1)
    slope = number * inside ** (number - 1)
    return inside**number + slope * (load_n[:, None] - inside), slope


def _table(table: ArrayResponse, place_mm: Array, own: slice) -> tuple[Array, Array, Array]:
    """(K, T + 2, numbers) the terms of the force and of the shear at places (K, 2), and their slopes along x and y."""
    both = np.concatenate([table.coefficient[..., own], table.shear[..., own]], axis=2)
    cells = len(table.coefficient) - 3
    x, x1 = _basis(place_mm[:, 0], table.first_mm, table.spacing_mm, cells)
    y, y1 = _basis(place_mm[:, 1], table.first_mm, table.spacing_mm, cells)
    across, across1 = (np.einsum("kb,abtp->katp", each, both, optimize=True) for each in (y, y1))
    value, along_x = (np.einsum("ka,katp->ktp", each, across) for each in (x, x1))
    return value, along_x, np.einsum("ka,katp->ktp", x, across1)


def _basis(along_mm: Array, first_mm: float, spacing_mm: float, cells: int) -> tuple[Array, Array]:
    """(K, cells + 3) cubic B-splines and their slopes; a place beyond the ends counts as on the end."""
    splines = cover(along_mm, first_mm, spacing_mm, cells)
    value, slope = np.zeros((2, len(along_mm), cells + 3))
    for out, of_splines in ((value, splines.value), (slope, splines.slope)):
        np.put_along_axis(out, splines.indices, of_splines, axis=1)
    return value, slope


def _symmetric(centre_mm: Array) -> Array:
    """(B², 5M, D) directions of the map that the pad's own mirror images leave as they are."""
    count, magnets = CELLS + 3, len(centre_mm)
    number = np.arange(count * count * magnets * CHANGE).reshape(count, count, magnets, CHANGE)
    images = []
    for transposed in (False, True):
        for sign in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
            moved = (centre_mm[:, ::-1] if transposed else centre_mm) * sign
            apart = np.hypot(*(moved[:, None] - centre_mm[None]).transpose(2, 0, 1))
            if apart.min(axis=1).max() > SAME_MM:
                continue
            taken = number.transpose(1, 0, 2, 3)[..., [1, 0, 2, 4, 3]] if transposed else number
            taken = taken[:: int(sign[0]), :: int(sign[1])]
            image = np.empty_like(taken)
            image[:, :, apart.argmin(axis=1)] = taken
            signs = np.broadcast_to([sign[0], sign[1], 1.0, sign[0], sign[1]], number.shape)
            images.append((image.ravel(), signs.ravel()))
    directions, known = [], np.zeros(number.size, dtype=np.bool_)
    for one in range(number.size):
        if known[one]:
            continue
        direction = np.zeros(number.size)
        for image, signs in images:
            # The image has at place i what was at place image[i].
            at = np.flatnonzero(image == one)
            direction[at] += signs[at]
            known[at] = True
        if np.abs(direction).max() > 0.0:
            directions.append(np.sign(direction))
    return np.array(directions).T.reshape(count * count, magnets * CHANGE, -1)
