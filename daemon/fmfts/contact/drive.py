"""How a finger may accelerate the magnet while nothing touches the pad; drive.c has the equation and the rest."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.matrix import product
from fmfts.contact.response import CHANGE, Response
from fmfts.pad import Array

# Found by `bench now` on six built pads: a tap of 1 N in 50 ms reaches 80 N/s, and reverses within 25 ms.
FORCE_DRIVE_N2_PER_S3 = 2e5
PLACE_DRIVE_MM2_PER_S3 = 3e6
# The next place is unknown: average over a grid with this many places a side, out to this share of the table, at this
# force.
PLACES, REACH, LIGHT_N = 9, 5.0 / 7.0, 0.1


def drive_power(loads: int) -> Array:
    """The power (2 + loads,) of x and y in mm²/s³, and of each load in N²/s³."""
    return np.array([PLACE_DRIVE_MM2_PER_S3] * 2 + [FORCE_DRIVE_N2_PER_S3] * loads)


def untouched_drive(response: Response, to_pose: Array) -> Array:
    """(5, 5) W, in the units of a pose's change: m, and tangents of the pad's rest axis. to_pose (5, 5): as below."""
    middle, half = (response.first_mm + response.last_mm) / 2.0, (response.last_mm - response.first_mm) / 2.0
    along = np.linspace(-REACH, REACH, PLACES)
    x_mm, y_mm = np.meshgrid(middle[0] + half[0] * along, middle[1] + half[1] * along, indexing="ij")
    press = np.zeros((x_mm.size, 2 + response.loads))
    press[:, 0], press[:, 1], press[:, 2] = x_mm.ravel(), y_mm.ravel(), LIGHT_N
    slope = product(to_pose, response.change_and_slope(press)[1])
    drive: Array = product(slope * drive_power(response.loads), slope.transpose(0, 2, 1)).mean(axis=0)
    return drive


def to_pose(tilt: Array) -> Array:
    """The matrix (5, 5) from changes in the response's units (mm, components of the nominal axis) to those of a pose.

    tilt (2, 2): components of the nominal axis, by the tangents of the pad's rest axis.
    """
    (a, b), (c, d) = tilt.tolist()
    matrix = 1e-3 * np.eye(CHANGE)
    matrix[3:, 3:] = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return matrix
