"""How a finger may accelerate the magnet: along the directions in which presses move it.

The finger's force and place are taken for twice integrated white noise. With S (5, 2 + L) the slopes of the pad's
response at the last contact, the magnet's pose accelerates as white noise of the power density

    W = S·diag(q)·Sᵀ,  q = PLACE_DRIVE for x and y, FORCE_DRIVE for each load

While nothing touches the pad, the next place is unknown: W is then the mean over the pad. `drive.c` does the same.
"""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.matrix import product
from fmfts.contact.estimate import ContactEstimate
from fmfts.contact.response import CHANGE, Response
from fmfts.pad import Array

# Found by `bench now` on six built pads: a tap of 1 N in 50 ms has 80 N/s at most, and turns round within 25 ms.
FORCE_DRIVE_N2_PER_S3 = 2e5
PLACE_DRIVE_MM2_PER_S3 = 3e6
# Where nothing touches: the mean over so many places along each side, out to this share of the table, at this force.
PLACES, REACH, LIGHT_N = 9, 5.0 / 7.0, 0.1


class Drive:
    """W (5, 5), in the units of a pose's change: m, and tangents of the pad's rest axis.

    to_pose (5, 5): from changes in the response's units (mm, components of the nominal axis) to those.
    """

    def __init__(self, response: Response, to_pose: Array) -> None:
        self._response, self._to_pose = response, to_pose
        self._power = np.full(2 + response.loads, FORCE_DRIVE_N2_PER_S3)
        self._power[:2] = PLACE_DRIVE_MM2_PER_S3
        middle, half = (response.first_mm + response.last_mm) / 2.0, (response.last_mm - response.first_mm) / 2.0
        along = np.linspace(-REACH, REACH, PLACES)
        x_mm, y_mm = np.meshgrid(middle[0] + half[0] * along, middle[1] + half[1] * along, indexing="ij")
        press = np.zeros((x_mm.size, 2 + response.loads))
        press[:, 0], press[:, 1], press[:, 2] = x_mm.ravel(), y_mm.ravel(), LIGHT_N
        self.untouched: Array = self._at(press).mean(axis=0)

    def at(self, contact: ContactEstimate | None) -> Array:
        """W at the last contact; None: nothing touches the pad."""
        if contact is None:
            return self.untouched
        press = np.zeros((1, 2 + self._response.loads))
        press[0, :3] = contact.x_m * 1e3, contact.y_m * 1e3, max(contact.force_n, 0.0)
        if contact.shear_n is not None:
            press[0, 3:] = contact.shear_n
        drive: Array = self._at(press)[0]
        return drive

    def _at(self, press: Array) -> Array:
        slope = product(self._to_pose, self._response.change_and_slope(press)[1])
        drive: Array = product(slope * self._power, slope.transpose(0, 2, 1))
        return drive


def to_pose(tilt: Array) -> Array:
    """`Drive`'s to_pose. tilt (2, 2): components of the nominal axis, by the tangents of the pad's rest axis."""
    (a, b), (c, d) = tilt.tolist()
    matrix = 1e-3 * np.eye(CHANGE)
    matrix[3:, 3:] = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return matrix
