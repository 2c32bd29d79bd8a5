"""The field of a small magnet (Eq. 1–6 of the paper) and its derivatives, at many places at once.

The field of a cylinder is that of a dipole plus that of an octupole (its even moments vanish). With m̂ the axis, r from
the magnet to the sensor, u = m̂·r, q = r², and κ = L²/4 − 3R²/4 the ratio of the two moments, the scalar potential is
B_T·(u q^−3/2 + κ(5/2 u³ q^−7/2 − 3/2 u q^−5/2)), so the field is B = B_T·(α m̂ + β r) with

    α = −q^−3/2 + κ(3/2 q^−5/2 − 15/2 u² q^−7/2)
    β = 3u q^−5/2 + κ(35/2 u³ q^−9/2 − 15/2 u q^−7/2)

κ = 0 gives Eq. 2, which is exact to this order for a cylinder with L/D = √3/2 = 0.866. κ follows from disks of charge
at the two end faces: the third moment ∫(z³ − 3/2 zρ²) over the first, ∫z. `look` and `differentiate` of model.h compute
them, and the derivatives by u and q.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Magnet
from fmfts.pose import _kernel

Array = NDArray[np.float64]


def octupole_m2(magnet: Magnet) -> float:
    """κ in m²: the octupole moment of a cylinder over its dipole moment."""
    return magnet.octupole_m2


def dipole_field(
    place_m: Array, position_m: Array, axis: Array, strength_t_m3: float, octupole_m2: float = 0.0
) -> Array:
    """Field (N, 3) in tesla at `place_m` (N, 3) of a magnet at `position_m` (3,) along the unit vector `axis` (3,).

    Eq. 2: B = B_T·(3(m̂·r)r/r⁵ − m̂/r³) with r from the magnet to the sensor; B_T is `Magnet.strength_t_m3`.
    """
    return dipole_derivatives(place_m, position_m, axis, strength_t_m3, octupole_m2)[0]


def dipole_derivatives(
    place_m: Array, position_m: Array, axis: Array, strength_t_m3: float, octupole_m2: float = 0.0
) -> tuple[Array, Array, Array]:
    """The field (N, 3) with its derivatives by magnet position (N, 3, 3), T/m, and by moment direction (N, 3, 3), T.

    The last index is the variable. The derivative by sensor position is minus that by magnet position.
    """
    places, position, along = (np.ascontiguousarray(each, dtype=np.float64) for each in (place_m, position_m, axis))
    field, by_position, by_axis = (np.empty((len(places), *shape)) for shape in ((3,), (3, 3), (3, 3)))
    _kernel.dipole(places, position, along, strength_t_m3, octupole_m2, field, by_position, by_axis)
    return field, by_position, by_axis
