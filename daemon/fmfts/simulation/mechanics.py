"""Computes how the magnet moves when the pad is pressed, from a table of presses solved by finite elements.

It interpolates by cubic splines over x and y, and by a polynomial in the force through zero, so that an unloaded pad is
exactly at rest. Beyond the largest force the displacement continues along its tangent. A press beyond the grid counts
as one on its edge. lab/README.md tells where the standard pad's table comes from, and how accurate it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Array


@dataclass(frozen=True, slots=True)
class Mechanics:
    """Displacement of a pad's magnet: splines over x and y of a polynomial in F, Ftx, Fty.

    exponents (T, 3): of the polynomial's terms. coefficient (X+2, X+2, T, 5): of their B-splines. sheared: the
    additional displacement by shear, on its own grid.
    """

    first_m: float
    spacing_m: float
    count: int
    largest_force_n: float
    exponents: NDArray[np.intp]
    coefficient: Array
    sheared: Mechanics | None = None

    @classmethod
    def from_table(cls, grid_m: Array, force_n: Array, response: Array) -> Mechanics:
        """Make it from `response` (X, X, L, 5), which is dx, dy, dz in m, axis x, y, at `grid_m` (X,) × `grid_m` ×
        `force_n` (L,)."""
        degree = np.arange(1, len(force_n) + 1, dtype=np.intp)
        powers = np.asarray(np.linalg.solve(force_n[:, None] ** degree, response), dtype=np.float64)
        exponents = np.stack([degree, 0 * degree, 0 * degree], axis=1)
        return cls.from_terms(grid_m, float(force_n[-1]), exponents, powers)

    @classmethod
    def from_terms(cls, grid_m: Array, largest_force_n: float, exponents: NDArray[np.intp], terms: Array) -> Mechanics:
        """Make it from the polynomial's terms (X, X, T, 5) on an evenly spaced grid (X,), X ≥ 5, for both x and y."""
        spline = np.linalg.inv(spline_collocation(len(grid_m)))[:, 1:-1]
        coefficient = np.einsum("ai,bj,ijpc->abpc", spline, spline, terms)
        return cls(float(grid_m[0]), float(grid_m[1] - grid_m[0]), len(grid_m), largest_force_n, exponents, coefficient)

    def displacement(
        self, x_m: Array, y_m: Array, force_n: Array, shear_x_n: Array | None = None, shear_y_n: Array | None = None
    ) -> tuple[Array, Array]:
        """The magnet's displacement in m (K, 3) and unit axis (K, 3) under presses (K,); its rest axis is +z."""
        response = self.response(x_m, y_m, force_n, shear_x_n, shear_y_n)
        tilt = response[:, 3:]
        upright = np.sqrt(1.0 - np.sum(tilt * tilt, axis=1, keepdims=True))
        return response[:, :3], np.concatenate([tilt, upright], axis=1)

    def response(
        self, x_m: Array, y_m: Array, force_n: Array, shear_x_n: Array | None = None, shear_y_n: Array | None = None
    ) -> Array:
        """(K, 5) displacement in m, and the unit axis' x and y (of a table of shear: what shear adds to both)."""
        column, along_x = self._stencil(x_m)
        row, along_y = self._stencil(y_m)
        patch = self.coefficient[column[:, :, None], row[:, None, :]]
        term = self._terms(force_n, shear_x_n, shear_y_n)
        response: Array = np.einsum("kp,kpc->kc", term, np.einsum("ka,kb,kabpc->kpc", along_x, along_y, patch))
        if self.sheared is not None and (shear_x_n is not None or shear_y_n is not None):
            response += self.sheared.response(x_m, y_m, force_n, shear_x_n, shear_y_n)
        return response

    def _terms(self, force_n: Array, shear_x_n: Array | None, shear_y_n: Array | None) -> Array:
        """(K, T) powers of the load; beyond the largest force, those of the normal force continue as tangents."""
        of_force, of_x, of_y = self.exponents.T
        inside = np.minimum(force_n, self.largest_force_n)[:, None]
        term: Array = inside**of_force
        beyond = force_n[:, None] - inside
        if np.any(beyond > 0.0):
            term = term + beyond * of_force * inside ** np.maximum(of_force - 1, 0)
        for shear_n, exponent in ((shear_x_n, of_x), (shear_y_n, of_y)):
            term = term * (exponent == 0 if shear_n is None else shear_n[:, None] ** exponent)
        return term

    def _stencil(self, coordinate_m: Array) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.intp]], Array]:
        """Indices (K, 4) and weights (K, 4) of the four cubic B-splines that cover each coordinate."""
        place = np.clip((coordinate_m - self.first_m) / self.spacing_m, 0.0, self.count - 1.0)
        cell = np.minimum(place.astype(np.intp), self.count - 2)
        u = place - cell
        weight = np.stack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3], axis=1) / 6.0
        return cell[:, None] + np.arange(4), weight


def spline_collocation(count: int) -> Array:
    """Matrix (count+2, count+2): B-spline coefficients → values at the knots, not-a-knot conditions at both ends."""
    matrix = np.zeros((count + 2, count + 2))
    for knot in range(count):
        matrix[knot + 1, knot : knot + 3] = 1 / 6, 4 / 6, 1 / 6
    matrix[0, :5] = matrix[-1, -5:] = 1, -4, 6, -4, 1
    return matrix
