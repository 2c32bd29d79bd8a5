"""The field of a magnet from its scalar potential, and what a sensor reads of it. Nothing here comes from the product.

Sources: the potential of a dipole, u/r³ with u = m̂·r (paper, Eq. 1 and 2: B = B_T·(3(m̂·r)r/r⁵ − m̂/r³) is minus its
gradient), and of the next moment of a uniformly magnetised cylinder, κ(5u³/r⁷ − 3u/r⁵)/2 with κ = L²/4 − 3R²/4, from
disks of charge at both faces (J. D. Jackson, Classical Electrodynamics, 4.1: P₃ over r⁴). The gradient of the ambient
field is symmetric and without trace (curl and divergence are zero). Gradients by complex steps: W. Squire, G. Trapp,
SIAM Review 40 (1998) 110; they have no difference of near numbers, so no step is too small.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TINY = 1e-30


@dataclass(frozen=True, slots=True)
class OneMagnet:
    """strength_t_m3: B_T at log moment 0. kappa_m2: 0 for a dipole."""

    position_m: Array
    axis: Array
    log_moment: float
    strength_t_m3: float
    kappa_m2: float = 0.0


def potential(r: NDArray[np.complex128], axis: Array, kappa: float) -> NDArray[np.complex128]:
    """(…,) over B_T, at r (…, 3) from the magnet."""
    u, q = r @ axis, (r * r).sum(axis=-1)
    dipole = u * q**-1.5
    if kappa == 0.0:
        return dipole
    return dipole + kappa * dipole * (2.5 * u * u / q - 1.5) / q


def field(magnet: OneMagnet, place_m: Array) -> Array:
    """(N, 3) in T."""
    strength = magnet.strength_t_m3 * np.exp(magnet.log_moment)
    steps = 1j * TINY * np.eye(3)[:, None, :]
    moved = potential((place_m - magnet.position_m) + steps, magnet.axis, magnet.kappa_m2).imag
    return -strength / TINY * moved.T


def reading(
    place_m: Array, direction: Array, magnets: Sequence[OneMagnet], ambient_t: Array, gradient_t_per_m: Array
) -> Array:
    """(rows,) what each scalar sensor reads. gradient_t_per_m (5,): xx, xy, xz, yy, yz."""
    xx, xy, xz, yy, yz = gradient_t_per_m
    gradient = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, -xx - yy]])
    total = ambient_t + place_m @ gradient.T + sum(field(magnet, place_m) for magnet in magnets)
    return np.asarray((direction * total).sum(axis=1))


def tangents(axis: Array) -> Array:
    """T (3, 2): T. Duff et al., JCGT 6 (2017)."""
    x, y, z = axis
    sign = 1.0 if z >= 0.0 else -1.0
    first = np.array([1.0 - sign * x * x / (sign + z), -sign * x * y / (sign + z), -sign * x])
    return np.stack([first, np.array([-x * y / (sign + z), sign - y * y / (sign + z), -y])], axis=1)


def turned(axis: Array, step: Array) -> Array:
    """docs/pose.md: a ⊞ h = (a + T h)/|a + T h|."""
    first, second = tangents(axis).T
    moved = axis + step[0] * first + step[1] * second
    return np.asarray(moved / np.sqrt(moved @ moved))


def differences(function: Callable[[Array], Array], at: Array, steps: Array) -> Array:
    """(values, unknowns) derivative by central differences of fourth order."""
    columns = []
    for number, step in enumerate(steps):
        move = np.zeros(len(at))
        move[number] = step
        near = function(at + move) - function(at - move)
        far = function(at + 2.0 * move) - function(at - 2.0 * move)
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.stack(columns, axis=-1)
