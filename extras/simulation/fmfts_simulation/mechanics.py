"""Computes how the magnet moves when the pad is pressed, from a table of presses solved by finite elements.

It interpolates by cubic splines over x and y, and by a polynomial in the force through zero, so that an unloaded pad is
exactly at rest. Beyond the largest force the displacement continues along its tangent. A press beyond the grid counts
as one on its edge. lab/README.md describes the origin and accuracy of the standard pad's table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.spline import cover, powers, spline_collocation
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
        """(K, 5) displacement in m, and the unit axis' x and y (of a table of shear: what shear adds to both).

        A press that equals the one before it is computed once: a finger that holds or is away repeats it many times.
        """
        press = [row for row in (x_m, y_m, force_n, shear_x_n, shear_y_n) if row is not None]
        changes = np.ones(len(force_n), bool)
        changes[1:] = np.any([row[1:] != row[:-1] for row in press], axis=0)
        x_m, y_m, force_n = x_m[changes], y_m[changes], force_n[changes]
        if shear_x_n is not None:
            shear_x_n = shear_x_n[changes]
        if shear_y_n is not None:
            shear_y_n = shear_y_n[changes]
        once = self._response(x_m, y_m, force_n, shear_x_n, shear_y_n)
        return np.asarray(once[np.cumsum(changes) - 1], dtype=np.float64)

    def _response(
        self, x_m: Array, y_m: Array, force_n: Array, shear_x_n: Array | None, shear_y_n: Array | None
    ) -> Array:
        along_x, along_y = (cover(at_m, self.first_m, self.spacing_m, self.count - 1) for at_m in (x_m, y_m))
        patch = self.coefficient[along_x.indices[:, :, None], along_y.indices[:, None, :]]
        term = self._terms(force_n, shear_x_n, shear_y_n)
        of_term = np.einsum("ka,kb,kabpc->kpc", along_x.value, along_y.value, patch)
        response: Array = np.einsum("kp,kpc->kc", term, of_term)
        if self.sheared is not None and (shear_x_n is not None or shear_y_n is not None):
            response += self.sheared._response(x_m, y_m, force_n, shear_x_n, shear_y_n)
        return response

    def _terms(self, force_n: Array, shear_x_n: Array | None, shear_y_n: Array | None) -> Array:
        """(K, T) powers of the load; beyond the largest force, those of the normal force continue as tangents."""
        of_force, of_x, of_y = self.exponents.T
        power = np.ones((len(force_n), 1 + int(of_force.max())))
        power[:, 1:] = powers(force_n, self.largest_force_n, power.shape[1] - 1)
        term: Array = power[:, of_force]
        for shear_n, exponent in ((shear_x_n, of_x), (shear_y_n, of_y)):
            term = term * (exponent == 0 if shear_n is None else shear_n[:, None] ** exponent)
        return term
