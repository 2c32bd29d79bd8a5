"""Simulates fingers of other shapes than the round patch of 6 mm that the table of presses was solved for.

A press by a small area moves the magnet like the mean of presses at its points. So only the area's second moments
count, to that order: those of the shape minus those of the patch, which are negative where the shape is narrower.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from fmfts.pad import Array, Magnet
from fmfts_simulation.mechanics import Mechanics

PATCH_MM2 = 6.0**2 / 16.0  # second moment of a disc of 6 mm, along any axis
SLIDING_FRICTION = 0.3
# A thimble's cap: 15 mm wide, 1 mm of steel. It acts like an iron plate: the magnet's image, weaker where it is small.
THIMBLE_SHARE = 0.8
THIMBLE_GAP_M = 0.2e-3


@dataclass(frozen=True, slots=True)
class FingerShape:
    """moments_mm2: along x and y, of all presses or of each (K,). shear: along x, as a share of the force. steel: the
    finger wears a thimble."""

    moments_mm2: tuple[float | Array, float | Array] = (PATCH_MM2, PATCH_MM2)
    shear: float = 0.0
    steel: bool = False

    def response(self, mechanics: Mechanics, press: Sequence[Array]) -> Array:
        """(K, 5) movement of the magnet by presses x, y (m), force and shear x, y (N; may be left out), each (K,)."""
        x_m, y_m, *load = press
        if self.shear:
            load = [load[0], self.shear * load[0], 0.0 * load[0]]
        whole = mechanics.response(x_m, y_m, *load)
        added = np.zeros_like(whole)
        for moment_mm2, along_x, along_y in zip(self.moments_mm2, (1.0, 0.0), (0.0, 1.0), strict=True):
            excess = np.asarray(moment_mm2 - PATCH_MM2)
            if np.all(excess == 0.0):
                continue
            away_m = np.sqrt(abs(excess)) * 1e-3
            sides = [
                mechanics.response(x_m + side * along_x * away_m, y_m + side * along_y * away_m, *load)
                for side in (1.0, -1.0)
            ]
            added += np.sign(excess)[..., None] * (np.mean(sides, axis=0) - whole)
        return np.asarray(whole + added, dtype=np.float64)


SHAPES = MappingProxyType(
    {
        "round": FingerShape(),
        "ball": FingerShape((3.0**2 / 16.0,) * 2),  # the contact of a ball, 3 mm wide
        "edge": FingerShape((10.0**2 / 12.0, 1.0 / 12.0)),  # 10 × 1 mm
        "flat": FingerShape((10.0**2 / 12.0,) * 2),  # 10 × 10 mm
        "angled": FingerShape((3.0**2 / 16.0, PATCH_MM2), shear=SLIDING_FRICTION),  # pressed obliquely, on its rim
        "thimble": FingerShape(steel=True),
    }
)


def thimble_field(places_m: Array, position_m: Array, axis: Array, top_m: float, magnet: Magnet) -> Array:
    """Field (…, 3) T at places (…, 3) of the steel above the magnet at position (…, 3), by the method of images.

    top_m: height of the pad's top over the magnet's centre. J. D. Jackson, Classical Electrodynamics, 5.11.
    """
    image_m = position_m + np.array([0.0, 0.0, 2.0 * (top_m + THIMBLE_GAP_M)])
    # The image of a moment under a plate of µ ≫ 1: its part along the plate turns around.
    moment = THIMBLE_SHARE * magnet.strength_t_m3 * axis * np.array([-1.0, -1.0, 1.0])
    away_m = places_m - image_m
    distance_m = np.linalg.norm(away_m, axis=-1, keepdims=True)
    along = np.sum(moment * away_m, axis=-1, keepdims=True) / distance_m**2
    return np.asarray((3.0 * along * away_m - moment) / distance_m**3)
