"""What is estimated of a magnet, and how a small step is taken from it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fmfts.pad import Pad

Array = NDArray[np.float64]

# Columns of a step: position (3), axis (2, in the tangent plane), log moment (1), uniform ambient field (3).
POSITION = slice(0, 3)
AXIS = slice(3, 5)
LOG_MOMENT = 5
AMBIENT = slice(6, 9)
SIZE = 9


@dataclass(frozen=True, slots=True)
class State:
    """Magnet pose, strength and ambient field.

    position_m (3,), axis (3,) unit vector, log_moment: ln(remanence / nominal remanence), ambient_t (3,) in pad axes,
    what the baseline did not subtract.
    """

    position_m: Array
    axis: Array
    log_moment: float
    ambient_t: Array

    @classmethod
    def at_rest(cls, pad: Pad) -> Self:
        return cls(pad.rest_position_m, pad.rest_axis, 0.0, np.zeros(3))

    def stepped(self, step: Array) -> Self:
        """The state moved by `step` (9,), SI units and radians; the axis stays a unit vector."""
        turned = self.axis + tangent_basis(self.axis) @ step[AXIS]
        return replace(
            self,
            position_m=self.position_m + step[POSITION],
            axis=turned / np.sqrt(turned @ turned),
            log_moment=self.log_moment + float(step[LOG_MOMENT]),
            ambient_t=self.ambient_t + step[AMBIENT],
        )

    def step_from(self, origin: State) -> Array:
        """The step (9,) that takes `origin` here: the inverse of `stepped`."""
        step = np.empty(SIZE)
        step[POSITION] = self.position_m - origin.position_m
        along = self.axis @ origin.axis
        # The retraction reaches less than 90°; beyond it, the shadow on the tangent plane still has the direction.
        step[AXIS] = tangent_basis(origin.axis).T @ self.axis / max(float(along), 1e-3)
        step[LOG_MOMENT] = self.log_moment - origin.log_moment
        step[AMBIENT] = self.ambient_t - origin.ambient_t
        return step


def tangent_basis(axis: Array) -> Array:
    """Two orthonormal vectors (3, 2) perpendicular to the unit vector `axis`; smooth wherever the axis is not −z.

    Duff et al., "Building an orthonormal basis, revisited", JCGT 6 (2017).
    """
    x, y, z = axis
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1.0 + sign * x * x * a, b], [sign * b, sign + y * y * a], [-sign * x, -y]])
