"""The wrench that a touching object exerts on a pad, with its covariance, from a contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Optional

from fmfts_client.contact import Vector

NAN = math.nan


@dataclass(frozen=True)
class Wrench:
    """In the pad's axes, about the frame's origin (in the sensors' plane). What is not known is NaN.

    A finger that presses pushes along −z, because z points toward it. The torque leaves out a twist of the finger about
    z, which the pad does not measure. place_m: where the force acts; None: nothing touches, so that neither shear nor
    torque is there.
    """

    force_n: Vector
    force_sd_n: Vector
    place_m: Optional[Vector]
    place_sd_m: tuple[float, float]

    @property
    def torque_nm(self) -> Vector:
        if self.place_m is None:
            return 0.0, 0.0, 0.0
        (fx, fy, fz), (x, y, z) = self.force_n, self.place_m
        return y * fz - z * fy, z * fx - x * fz, x * fy - y * fx

    @property
    def covariance(self) -> tuple[tuple[float, ...], ...]:
        """The covariance (6, 6) of force and torque, in N², N²·m and N²·m². Messages have deviations alone: the three
        parts of the force and the two of the place are taken as independent, and the height as exact.
        """
        variances = [sd * sd for sd in (*self.force_sd_n, *self.place_sd_m)]
        by_force_and_place = self._derivatives()
        return tuple(
            tuple(
                # 0 · NaN is NaN, but a result that does not depend on an unknown part is known.
                sum(a * b * variance for a, b, variance in zip(one, other, variances) if a != 0.0 and b != 0.0)
                for other in by_force_and_place
            )
            for one in by_force_and_place
        )

    def _derivatives(self) -> list[tuple[float, float, float, float, float]]:
        """Derivatives (6, 5) of force and torque by the force and the place along x and y."""
        force = [(1.0, 0.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0, 0.0)]
        if self.place_m is None:
            return force + [(0.0, 0.0, 0.0, 0.0, 0.0)] * 3
        (fx, fy, fz), (x, y, z) = self.force_n, self.place_m
        return [*force, (0.0, -z, y, 0.0, fz), (z, 0.0, -x, -fz, 0.0), (-y, x, 0.0, fy, -fx)]


def wrench_of(contact: Any, height_m: float, unknown_shear_n: float = NAN, unknown_shear_sd_n: float = NAN) -> Wrench:
    """The wrench of a Contact, or of what has as much of it. Its force must be known, and not over range.

    height_m: height above the sensors at which the force acts: z of the resting magnet, `rest_position_m` of the
    command `pads`. unknown_shear_n, unknown_shear_sd_n: replace shear along x and along y if the contact model gives
    none.
    """
    normal_n, normal_sd_n = _or(contact.force_n, NAN), _or(contact.force_sd_n, NAN)
    if contact.contact is False:  # noise, weaker than any touch
        return Wrench((0.0, 0.0, -normal_n), (0.0, 0.0, normal_sd_n), None, (0.0, 0.0))
    return Wrench(
        (_or(contact.shear_x_n, unknown_shear_n), _or(contact.shear_y_n, unknown_shear_n), -normal_n),
        (_or(contact.shear_x_sd_n, unknown_shear_sd_n), _or(contact.shear_y_sd_n, unknown_shear_sd_n), normal_sd_n),
        (_or(contact.x_m, NAN), _or(contact.y_m, NAN), height_m),
        (_or(contact.x_sd_m, NAN), _or(contact.y_sd_m, NAN)),
    )


def _or(value: Optional[float], otherwise: float) -> float:
    return otherwise if value is None else value
