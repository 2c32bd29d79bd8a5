"""Several magnets in one pad: their poses, and the field of all of them together, with its derivatives.

The field is the sum of the magnets' fields; `dipole.py` has the equation of one. A change of pose is five numbers for
each magnet, as for a single one: its displacement, and the x and y of its axis in axes in which it points along +z at
rest (mechanics move an upside-down magnet's axis like any other).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp
from fmfts.arithmetic.matrix import added
from fmfts.pad import Pad, SensorArray
from fmfts.pose import _kernel
from fmfts.pose.dipole import dipole_field
from fmfts.pose.state import tangent_basis

Array = NDArray[np.float64]
CHANGE = 5  # numbers of a magnet's change of pose


@dataclass(frozen=True, slots=True)
class Magnets:
    """M magnets. position_m (M, 3), axis (M, 3) unit vectors of their moments, strength_t_m3 (M,), octupole_m2 (M,)."""

    position_m: Array
    axis: Array
    strength_t_m3: Array
    octupole_m2: Array

    @classmethod
    def drawn(cls, pad: Pad) -> Magnets:
        """The magnets of the drawing, at rest."""
        magnets = pad.magnets
        return cls(
            np.array([one.rest_position_m for one in magnets]),
            np.array([one.rest_axis for one in magnets]),
            np.array([one.magnet.strength_t_m3 for one in magnets]),
            np.array([one.magnet.modelled_octupole_m2 for one in magnets]),
        )

    def __len__(self) -> int:
        return len(self.position_m)

    def stronger(self, log_moment: Array) -> Magnets:
        """The magnets with other moments. log_moment (M,): ln of the ratio."""
        ratio = np.array([exp(one) for one in log_moment.tolist()])
        return replace(self, strength_t_m3=self.strength_t_m3 * ratio)

    def changed(self, change: Array, frames: Array) -> Magnets:
        """The magnets after a change of pose (5M,), in m and components of the axis. frames (M, 3, 3): `rest_frames` of
        these.
        """
        position, axis = np.empty(self.position_m.shape), np.empty(self.axis.shape)
        _kernel.move(*map(np.ascontiguousarray, (frames, self.position_m, change)), position, axis)
        return replace(self, position_m=position, axis=axis)


def rest_frames(axis: Array) -> Array:
    """(M, 3, 3) rotations whose third column is the axis at rest: the shortest from +z, or from −z for one that points
    down. So x and y of the changed axis are those of the pad, but for the small tilt at rest."""
    frames = []
    for one in axis:
        sign = 1.0 if one[2] >= 0.0 else -1.0
        basis = tangent_basis(sign * one)
        frames.append(np.column_stack([sign * basis[:, 0], sign * basis[:, 1], one]))
    return np.array(frames)


def field_of(magnets: Magnets, sensors: SensorArray) -> Array:
    """(N, 3) the field at the sensors, along their axes, in T."""
    return sensors.to_sensor(sum_of_fields(magnets, sensors.position_m))


def sum_of_fields(magnets: Magnets, place_m: Array) -> Array:
    """(N, 3) the field at `place_m` (N, 3), in pad axes, in T."""
    each = zip(magnets.position_m, magnets.axis, magnets.strength_t_m3, magnets.octupole_m2, strict=True)
    return added([dipole_field(place_m, *one) for one in each])


def field_and_slope(magnets: Magnets, frames: Array, sensors: SensorArray) -> tuple[Array, Array]:
    """The field (N, 3) along the sensors' axes, and its derivative (3N, 5M) by the changes of pose."""
    field, slope = np.empty((len(sensors), 3)), np.empty((3 * len(sensors), CHANGE * len(magnets)))
    together = (magnets.position_m, magnets.axis, frames, magnets.strength_t_m3, magnets.octupole_m2)
    _kernel.fields(*map(np.ascontiguousarray, (*together, sensors.position_m, sensors.axes)), field, slope)
    return field, slope
