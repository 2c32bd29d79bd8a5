"""The rest field and the height of contact of a pad that nobody recorded untouched, from its presses.

Over all places the field tends to one and the same, the rest, as the load tends to none:

    field(x, y, d) = rest + S(x, y) · (d − d₀)^p

With S a spline and p and d₀ of a grid this is linear. Presses of half a millimetre of different depths tell the rest of
eFlesh's pad to 40 µT, those of 4 mm to 15 µT; p and d₀ hardly matter for it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from fmfts.pad import Array
from fmfts_skin.calibrate.field_splines import SplineFit
from fmfts_skin.field_response import Axis

POWERS = (1.0, 1.3, 1.6, 2.0)
# Heights of contact above the least depth that was pressed, mm. A force begins at zero.
HEIGHTS_MM = (0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
ROUGHNESS, RIDGE = 1e-2, 1e-6


class Rest(NamedTuple):
    """field_ut (P,) of the untouched pad, and the load at which contacts begin."""

    field_ut: Array
    load: float


def rest_of_presses(places: tuple[Axis, ...], contact: Array, field_ut: Array, load: str) -> Rest:
    """The rest by presses (K, 3) at many places and loads, and their fields (K, P). load: what the last coordinate
    is.
    """
    fit = SplineFit(places, ROUGHNESS, None)
    basis = fit.basis(contact[:, :-1])
    pressed, least = contact[:, -1], float(contact[:, -1].min())
    begins = [least - height for height in HEIGHTS_MM] if load == "depth_mm" else [min(least, 0.0)]
    found = [
        (*_solved(fit, basis * ((pressed - begin) / np.ptp(pressed))[:, None] ** power, field_ut), begin)
        for begin in begins
        for power in POWERS
    ]
    _, rest, begin = min(found, key=lambda one: one[0])
    return Rest(rest, begin)


def _solved(fit: SplineFit, scaled: Array, field_ut: Array) -> tuple[float, Array]:
    """The mean square that is left, and the rest."""
    columns = np.column_stack([np.ones(len(scaled)), scaled])
    normal = columns.T @ columns
    inner = normal[1:, 1:]
    inner += np.trace(inner) / len(inner) * (fit.penalty + RIDGE * np.eye(len(inner)))
    solution = scipy.linalg.solve(normal, columns.T @ field_ut, assume_a="pos")
    return float(np.mean((field_ut - columns @ solution) ** 2)), solution[0]
