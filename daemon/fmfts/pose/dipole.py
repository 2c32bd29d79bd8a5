"""The magnetic dipole (Eq. 1–6 of the paper) and its derivatives, at many sensors at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IDENTITY = np.eye(3)


def dipole_field(place_m: Array, position_m: Array, axis: Array, strength_t_m3: float) -> Array:
    """Field (N, 3) in tesla at `place_m` (N, 3) of a dipole at `position_m` (3,) along the unit vector `axis` (3,).

    Eq. 2: B = B_T·(3(m̂·r)r/r⁵ − m̂/r³) with r from the magnet to the sensor; B_T is `Magnet.strength_t_m3`.
    """
    r = place_m - position_m
    square = (r * r).sum(axis=1)
    inverse_cube = square**-1.5
    along = 3.0 * (r @ axis) * inverse_cube / square
    field: Array = strength_t_m3 * (along[:, None] * r - inverse_cube[:, None] * axis)
    return field


def dipole_derivatives(
    place_m: Array, position_m: Array, axis: Array, strength_t_m3: float
) -> tuple[Array, Array, Array]:
    """The field (N, 3) with its derivatives by magnet position (N, 3, 3), T/m, and by moment direction (N, 3, 3), T.

    The last index is the variable. By sensor position, the derivative is the negative of that by magnet position.
    """
    r = place_m - position_m
    square = (r * r).sum(axis=1)
    inverse_square = 1.0 / square
    cube = strength_t_m3 * inverse_square * np.sqrt(inverse_square)
    fifth = (3.0 * cube * inverse_square)[:, None, None]
    dot = r @ axis
    outer = r[:, :, None] * r[:, None, :]
    by_axis = fifth * outer - cube[:, None, None] * IDENTITY
    field = by_axis @ axis
    mixed = r[:, :, None] * axis
    along = dot[:, None, None]
    by_position = fifth * (
        (5.0 * dot * inverse_square)[:, None, None] * outer - mixed - mixed.transpose(0, 2, 1) - along * IDENTITY
    )
    return field, by_position, by_axis
