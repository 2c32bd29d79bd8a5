"""The field of a small magnet (Eq. 1–6 of the paper) and its derivatives, at many places at once.

The field of a cylinder is that of a dipole plus that of an octupole (its even moments vanish). With m̂ the axis, r from
the magnet to the sensor, u = m̂·r, q = r², and κ = L²/4 − 3R²/4 the ratio of the two moments, the scalar potential is
B_T·(u q^−3/2 + κ(5/2 u³ q^−7/2 − 3/2 u q^−5/2)), so the field is B = B_T·(α m̂ + β r) with

    α = −q^−3/2 + κ(3/2 q^−5/2 − 15/2 u² q^−7/2)
    β = 3u q^−5/2 + κ(35/2 u³ q^−9/2 − 15/2 u q^−7/2)

κ = 0 gives Eq. 2, which is exact to this order for a cylinder with L/D = √3/2 = 0.866. κ follows from disks of charge
at the two end faces: the third moment ∫(z³ − 3/2 zρ²) over the first, ∫z.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product
from fmfts.pad import Magnet

Array = NDArray[np.float64]
IDENTITY = np.eye(3)


class Radial(NamedTuple):
    """α and β, their derivatives by u, and twice their derivatives by q; each (N,)."""

    alpha: Array
    beta: Array
    alpha_u: Array
    beta_u: Array
    alpha_2q: Array
    beta_2q: Array


def octupole_m2(magnet: Magnet) -> float:
    """κ in m²: the octupole moment of a cylinder over its dipole moment."""
    return magnet.octupole_m2


def dipole_field(
    place_m: Array, position_m: Array, axis: Array, strength_t_m3: float, octupole_m2: float = 0.0
) -> Array:
    """Field (N, 3) in tesla at `place_m` (N, 3) of a magnet at `position_m` (3,) along the unit vector `axis` (3,).

    Eq. 2: B = B_T·(3(m̂·r)r/r⁵ − m̂/r³) with r from the magnet to the sensor; B_T is `Magnet.strength_t_m3`.
    """
    r = place_m - position_m
    radial = radial_of(product(r, axis), (r * r).sum(axis=1), octupole_m2)
    field: Array = strength_t_m3 * (radial.alpha[:, None] * axis + radial.beta[:, None] * r)
    return field


def dipole_derivatives(
    place_m: Array, position_m: Array, axis: Array, strength_t_m3: float, octupole_m2: float = 0.0
) -> tuple[Array, Array, Array]:
    """The field (N, 3) with its derivatives by magnet position (N, 3, 3), T/m, and by moment direction (N, 3, 3), T.

    The last index is the variable. The derivative by sensor position is minus that by magnet position.
    """
    r = place_m - position_m
    alpha, beta, alpha_u, beta_u, alpha_2q, beta_2q = (
        strength_t_m3 * value[:, None, None] for value in radial_of(product(r, axis), (r * r).sum(axis=1), octupole_m2)
    )
    along, across = np.broadcast_to(axis[:, None], (len(r), 3, 1)), r[:, :, None]
    by_u = alpha_u * along + beta_u * across
    by_2q = alpha_2q * along + beta_2q * across
    field = (alpha * along + beta * across)[:, :, 0]
    by_axis = by_u * r[:, None, :] + alpha * IDENTITY
    by_position = -(by_u * axis + by_2q * r[:, None, :] + beta * IDENTITY)
    return field, by_position, by_axis


def radial_of(u: Array, q: Array, octupole_m2: float) -> Radial:
    inverse = 1.0 / q
    third = inverse * np.sqrt(inverse)
    fifth = third * inverse
    dipole = Radial(-third, 3.0 * u * fifth, 0.0 * u, 3.0 * fifth, 3.0 * fifth, -15.0 * u * fifth * inverse)
    if octupole_m2 == 0.0:
        return dipole
    scaled = octupole_m2 * fifth
    w = u * inverse
    uw = u * w
    octupole = Radial(
        alpha=scaled * (1.5 - 7.5 * uw),
        beta=scaled * w * (17.5 * uw - 7.5),
        alpha_u=scaled * -15.0 * w,
        beta_u=scaled * inverse * (52.5 * uw - 7.5),
        alpha_2q=scaled * inverse * (52.5 * uw - 7.5),
        beta_2q=scaled * inverse * w * (52.5 - 157.5 * uw),
    )
    return Radial(*(first + second for first, second in zip(dipole, octupole, strict=True)))
