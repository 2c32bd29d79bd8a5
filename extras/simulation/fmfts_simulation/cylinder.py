"""Computes the exact field of a finite, axially magnetised cylinder, the reference for the solver's dipole.

N. Derby, S. Olbert, "Cylindrical magnets and ideal solenoids", Am. J. Phys. 78 (2010) 229, doi:10.1119/1.3256157,
Eqs. 2–8; the same formulas in A. Caciagli et al., J. Magn. Magn. Mater. 456 (2018) 423.
"""

from __future__ import annotations

import numpy as np

from fmfts.pad import Array, Magnet


def generalized_elliptic_integral(kc: Array, p: Array, c: Array, s: Array) -> Array:
    """Bulirsch's complete elliptic integral cel(kc, p, c, s) for kc ≠ 0, p > 0, elementwise; the arrays broadcast.

    The arithmetic–geometric mean converges quadratically: when successive means agree to 1e-8 the integral is exact
    to rounding. R. Bulirsch, Numer. Math. 13 (1969) 305.
    """
    mean, geometric, product = 1.0 + kc, kc, kc
    previous: Array = np.ones_like(kc)
    p = np.sqrt(p)
    s = s / p
    c, carried = c + s / p, c
    g = kc / p
    s = 2.0 * (s + carried * g)
    p = g + p
    while np.any(np.abs(previous - geometric) > 1e-8 * previous):
        geometric = 2.0 * np.sqrt(product)
        product = geometric * mean
        c, carried = c + s / p, c
        g = product / p
        s = 2.0 * (s + carried * g)
        p = g + p
        previous, mean = mean, mean + geometric
    integral: Array = (np.pi / 2.0) * (s + c * mean) / (mean * (mean + p))
    return integral


def cylinder_field(point_m: Array, position_m: Array, axis: Array, magnet: Magnet) -> Array:
    """Field in tesla (…, 3) at `point_m` (…, 3) of a cylinder centred at `position_m` (…, 3) along unit `axis` (…, 3).

    The three arrays broadcast against each other. Not valid on the edges of the two end faces.
    """
    radius = magnet.diameter_m / 2.0
    offset = point_m - position_m
    height = np.sum(offset * axis, axis=-1)
    across = offset - height[..., None] * axis
    distance = np.sqrt(np.sum(across * across, axis=-1))

    ends = np.stack([height + magnet.length_m / 2.0, height - magnet.length_m / 2.0])
    reach = np.sqrt(ends**2 + (distance + radius) ** 2)
    modulus = np.sqrt(ends**2 + (distance - radius) ** 2) / reach
    gamma = np.broadcast_to((radius - distance) / (radius + distance), modulus.shape)
    one = np.ones_like(modulus)
    radial_integral, axial_integral = generalized_elliptic_integral(
        modulus, np.stack([one, gamma**2]), one, np.stack([-one, gamma])
    )
    radial = radius / reach * radial_integral
    axial = ends / reach * axial_integral * (radius / (radius + distance))

    scale = magnet.remanence_t / np.pi
    outward = across / np.where(distance > 0.0, distance, 1.0)[..., None]
    field: Array = scale * ((radial[0] - radial[1])[..., None] * outward + (axial[0] - axial[1])[..., None] * axis)
    return field
