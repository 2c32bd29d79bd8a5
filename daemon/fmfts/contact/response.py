"""The pad's response: a table of how presses change the magnet's pose, and the most likely press for a change.

Cubic B-splines over the place, times monomials of the load, so that an unloaded pad is exactly at rest:

    change(x, y, load) = Σ_ij B_i(x) B_j(y) Σ_m c_ijm Π_l (load_l / scale)^e_ml

Beyond the largest normal force the change continues along its tangent. A place beyond the table counts as on its edge.
Units are those of the contact model: mm, N, and components of the axis. response.c computes all of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.contact import _contact

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Prior deviation of each shear, divided by friction times force: for a uniform distribution over the disc of the
# friction cone.
SHARE_OF_CONE = 0.5
CHANGE = 5  # a, b, c in mm, and the axis's m and n


@dataclass(frozen=True, slots=True)
class Response:
    """first_mm (2,) and spacing_mm (2,): the table's knots along x and y, equally spaced. exponent (M, L): powers of
    the L loads (normal force, then shear) in M monomials. scale_n: largest calibrated normal force. coefficient
    (X + 2, Y + 2, M, 5) for X × Y knots. friction: largest calibrated shear, as a share of the normal force."""

    first_mm: Array
    spacing_mm: Array
    scale_n: float
    exponent: Indices
    coefficient: Array
    friction: float = 0.0

    @property
    def loads(self) -> int:
        return int(self.exponent.shape[1])

    @property
    def last_mm(self) -> Array:
        """The last knots (2,)."""
        last: Array = self.first_mm + self.spacing_mm * (np.array(self.coefficient.shape[:2]) - 3)
        return last

    def without_shear(self) -> Response:
        """The response to normal forces alone."""
        normal = (self.exponent[:, 1:] == 0).all(axis=1)
        return replace(
            self, exponent=self.exponent[normal, :1], coefficient=self.coefficient[:, :, normal], friction=0.0
        )

    def change(self, press: Array) -> Array:
        """The change of pose (K, 5) under presses (K, 2 + L): x, y in mm, loads in N."""
        return self.change_and_slope(press)[0]

    def change_and_slope(self, press: Array) -> tuple[Array, Array]:
        """The change (K, 5), and its derivative (K, 5, 2 + L) by the press."""
        change, slope = np.empty((len(press), CHANGE)), np.empty((len(press), CHANGE, 2 + self.loads))
        _contact.respond(self.packed(), np.ascontiguousarray(press, dtype=float), change, slope)
        return change, slope

    def basis(self, press: Array) -> Array:
        """The factor (K, X + 2, Y + 2, M) of each coefficient: `change` is linear in the coefficients."""
        basis = np.empty((len(press), *self.coefficient.shape[:3]))
        _contact.basis(self.packed(), np.ascontiguousarray(press, dtype=float), basis)
        return basis

    def packed(self) -> bytes:
        """As refine.h reads it."""
        size_x, size_y, monomials, _ = self.coefficient.shape
        sizes = np.array([size_x - 2, size_y - 2, monomials, self.loads])
        table = np.concatenate([sizes, self.first_mm, self.spacing_mm, [self.scale_n]])
        exponent = np.ascontiguousarray(self.exponent, dtype=np.int32)
        return table.tobytes() + np.ascontiguousarray(self.coefficient).tobytes() + exponent.tobytes()
