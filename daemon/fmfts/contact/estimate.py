"""What a contact model answers, and how far a force may be none."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.pad import Array

# A force is certain if it is this many deviations above zero.
CERTAIN_FORCE_DEVIATIONS = 2.0


@dataclass(frozen=True, slots=True)
class ContactEstimate:
    """Place, force and their covariance: (3, 3) over x_m, y_m, force_n, or (5, 5) with shear. All are finite.

    over_range: the pose or the force is beyond what the model was trained on. x_m, y_m and force_n are then those of
    the nearest pose that it knows; only force_min_n, a lower bound of the force, can be trusted. Else that is None.
    lifted_m: how far the magnet certainly is above all that training saw; 0 if it is not. central_force_sd_n: the
    deviation of the same force in the middle of the pad: without a touch there is no place whose errors could count.
    pose_force_sd_n: the part of the force's deviation that the pose's covariance causes; the other parts grow with the
    force, and make none where there is none.
    shear_n (2,): force along x and y; None from a model of three outputs. refused: a model of five outputs found the
    press outside of where it can tell shear from place: none of its numbers can be trusted.
    """

    x_m: float
    y_m: float
    force_n: float
    covariance: Array
    over_range: bool
    force_min_n: float | None
    lifted_m: float
    central_force_sd_n: float
    pose_force_sd_n: float
    shear_n: Array | None = None
    refused: bool = False

    @property
    def values(self) -> Array:
        """(3,) or (5,): x, y (m), force, and shear x, y (N)."""
        pressed = np.array([self.x_m, self.y_m, self.force_n])
        return pressed if self.shear_n is None else np.concatenate([pressed, self.shear_n])

    @property
    def x_sd_m(self) -> float:
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def y_sd_m(self) -> float:
        return float(np.sqrt(self.covariance[1, 1]))

    @property
    def force_sd_n(self) -> float:
        return float(np.sqrt(self.covariance[2, 2]))


def doubt(force_n: float, variance: float) -> float:
    """How far noise of this variance (N²) alone could explain the force, from 0 to 1: g of Fieller's theorem.

    A place is a ratio: how far the magnet tilts and shifts, over how far it sinks. The deviation of such a ratio grows
    by 1/√(1 − g).
    """
    least = square(CERTAIN_FORCE_DEVIATIONS) * variance
    return least / square(force_n) if force_n > 0.0 and least < square(force_n) else 1.0


def astray_share(doubt: float) -> float:
    """The probability that a place is far from the true one: the doubt of its force, to the power of 2.5."""
    return doubt * doubt * sqrt(doubt)
