"""Draws pads as people build them: other silicone, thickness and fingers than the drawing's, within the tolerances.

The errors of a contact model about one pad are the same in each of its messages. So one pad says little about
deviations: draw many. Learners draw another in each episode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from fmfts.config import PadConfig
from fmfts.pad import Array
from fmfts_simulation.finger_shape import FingerShape
from fmfts_simulation.mechanics import Mechanics

# The magnet's movement (dx, dy, dz, axis x, y) grows with this power of the slab's thickness, under a normal force and
# under shear. From the presses that CalculiX solved on slabs of 3.6, 4 and 4.4 mm with a finger of 6 mm
# (lab/fmfts_lab/bench/cast_presses.csv): those powers give sinking and tilt within 3 % at each place and force.
BY_FORCE = np.array([2.0, 2.0, -2.4, -2.7, -2.7])
BY_SHEAR = np.array([-1.7, -1.7, -2.4, -2.3, -2.3])
DRAWN_M = 4e-3  # the thickness of the slab that every pad is drawn with: the middle one of these three
THINNEST = 0.5  # as a share of the drawn thickness: less is no pad


@dataclass(frozen=True, slots=True)
class Structures:
    """The materials of K pads. modulus, thickness: as shares of the drawn ones. moment_mm2: of the finger's face."""

    modulus: Array
    thickness: Array
    moment_mm2: Array

    @classmethod
    def drawn(cls, pads: Sequence[PadConfig], random: np.random.Generator) -> Structures:
        """Within `[pad.tolerance] modulus`, `thickness_mm` and `[pad.contact] finger_mm` of each pad."""
        told = [pad.structure_tolerance() for pad in pads]
        modulus = np.exp(random.normal(0.0, [each.modulus for each in told]))  # as StructureTolerance says
        thickness = random.normal(1.0, [each.thickness_m / DRAWN_M for each in told])
        width_mm = 1e3 * random.uniform(*np.array([each.finger_m for each in told]).T)
        return cls(modulus, np.maximum(thickness, THINNEST), width_mm**2 / 16.0)

    def response(self, mechanics: Mechanics, pad: np.ndarray, press: Sequence[Array]) -> Array:
        """(C, 5) as `Mechanics.response`, of the pads (C,). press: x, y, force, and shear x, y if there is any.

        A higher modulus takes proportionally more load for the same movement.
        """
        x_m, y_m, *load = press
        force_n, *shear_n = (each / self.modulus[pad] for each in load)
        moment_mm2 = self.moment_mm2[pad]
        finger = FingerShape((moment_mm2, moment_mm2))
        thickness = self.thickness[pad, None]
        by_force = finger.response(mechanics, (x_m, y_m, force_n))
        response = by_force * thickness**BY_FORCE
        if shear_n:
            whole = finger.response(mechanics, (x_m, y_m, force_n, *shear_n))
            response = response + (whole - by_force) * thickness**BY_SHEAR
        return np.asarray(response)
