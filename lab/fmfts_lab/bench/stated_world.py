"""Silicone and fingers that differ from the contact model's by what the default tolerances state: see tolerances.py.

Deviations count all of it. So only pads that are drawn from it can judge whether they are as large as errors. Whether
its tables are right is for `structure`, which has presses of another solver.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.contact.tolerances import FINGER_M, MODULUS, RING_MM, THICKER_MM, THICKER_SHARE, THICKNESS_M
from fmfts.pad import Array
from fmfts_simulation.finger_shape import PATCH_MM2, FingerShape
from fmfts_simulation.mechanics import Mechanics

# Half the difference of a finger's moments along and across, as a share of their common error: tolerances.c.
UNEVEN = 0.5
NARROWEST_MM2 = 0.05


@dataclass(frozen=True, slots=True)
class StatedMechanics:
    """A pad's mechanics, as its silicone and what presses it make them. thicker_mm: than the model's slab."""

    model: Mechanics
    modulus: float
    thicker_mm: float
    finger: FingerShape

    @classmethod
    def drawn(cls, model: Mechanics, random: np.random.Generator) -> StatedMechanics:
        disc_mm2 = (1e3 * random.uniform(*FINGER_M)) ** 2 / 16.0
        farthest_mm2 = (1e3 * FINGER_M[1]) ** 2 / 16.0 - PATCH_MM2
        uneven_mm2 = random.normal(0.0, UNEVEN * farthest_mm2 / 2.0)
        moments = (max(disc_mm2 + uneven_mm2, NARROWEST_MM2), max(disc_mm2 - uneven_mm2, NARROWEST_MM2))
        modulus = float(np.exp(random.normal(0.0, MODULUS)))
        return cls(model, modulus, 1e3 * random.normal(0.0, THICKNESS_M), FingerShape(moments))

    def response(self, x_m: Array, y_m: Array, force_n: Array) -> Array:
        """(K, 5) movement of the magnet, as `Mechanics.response`."""
        radius_m = np.maximum(np.hypot(x_m, y_m), 1e-9)
        rings_m = 1e-3 * RING_MM * np.arange(len(THICKER_MM))
        outwards_m = 1e-3 * self.thicker_mm * np.interp(radius_m, rings_m, THICKER_MM)
        # Each further step of thickness takes the same share of the force. A slab that is solved 0.6 mm thicker moves
        # as with 0.72 of the force: the exponential says 0.71, a straight line 0.65.
        share = np.exp(self.thicker_mm * np.interp(radius_m, rings_m, THICKER_SHARE))
        as_if = 1.0 + outwards_m / radius_m
        press = x_m * as_if, y_m * as_if, force_n / self.modulus * share
        return self.finger.response(self.model, press)
