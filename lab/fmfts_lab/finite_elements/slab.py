"""Describes the pad as a solid: a silicone slab on a rigid rim, a magnet inside, and a round patch pressed on top."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fmfts.pad import Array

ELEMENT_M = 1e-3  # edge of the finite elements, unless the user asks for another
RADII, ANGLES = 8, 40  # points under the probe: a finer rule moves the magnet by less than 1e-4 of its displacement


class Press(NamedTuple):
    """A load: the patch's centre in m, the normal force and the shear in N (the probe pushes along +x, +y)."""

    x_m: float
    y_m: float
    force_n: float
    shear_x_n: float = 0.0
    shear_y_n: float = 0.0


@dataclass(frozen=True, slots=True)
class Slab:
    """The standard pad. Lengths in m from the slab's bottom face upwards, moduli in Pa.

    The silicone is a Mooney–Rivlin solid, W = C10 (Ī1 − 3) + C01 (Ī2 − 3) + K/2 (J − 1)². The bottom face of the rim is
    fixed, the bottom within it free; the magnets, all of one size, are rigid. magnets_m: (x, y) of each one's centre.
    """

    width_m: float = 40e-3
    thickness_m: float = 4e-3
    rim_m: float = 3e-3
    magnet_height_m: float = 2e-3
    magnet_diameter_m: float = 2e-3
    magnet_length_m: float = 2e-3
    patch_diameter_m: float = 6e-3
    c10_pa: float = 0.162416e6
    c01_pa: float = 0.040604e6
    bulk_pa: float = 20.30201e6
    magnets_m: tuple[tuple[float, float], ...] = ((0.0, 0.0),)

    def __post_init__(self) -> None:
        """Raises ValueError, which names the first impossible length or modulus."""
        for name in self.__slots__:
            if name == "magnets_m":
                continue
            value = getattr(self, name)
            if not (np.isfinite(value) and (value > 0.0 or (name == "c01_pa" and value == 0.0))):
                raise ValueError(f"{name} = {value:g}: must be positive")
        half = self.magnet_length_m / 2.0
        if not half < self.magnet_height_m < self.thickness_m - half:
            raise ValueError(
                f"a magnet of {self.magnet_length_m * 1e3:g} mm, centred {self.magnet_height_m * 1e3:g} mm above the "
                f"slab's bottom, does not lie inside a slab of {self.thickness_m * 1e3:g} mm"
            )
        farthest_m = max(abs(along) for place in self.magnets_m for along in place)
        if not 2.0 * (farthest_m + self.magnet_diameter_m) < self.width_m - 2.0 * self.rim_m:
            raise ValueError("within the rim, silicone as wide as half the magnet's diameter must surround each magnet")
        if not self.reach_m > 0.0:
            raise ValueError(f"a patch of {self.patch_diameter_m * 1e3:g} mm does not fit within the rim")

    @property
    def shear_modulus_pa(self) -> float:
        """µ = 2 (C10 + C01), for small strains."""
        return 2.0 * (self.c10_pa + self.c01_pa)

    @property
    def reach_m(self) -> float:
        """Largest distance along x or y at which a patch lies within the rim."""
        return (self.width_m - self.patch_diameter_m) / 2.0 - self.rim_m

    def patch_points(self, x_m: float, y_m: float) -> Array:
        """(P, 2) places in m, in rings of equal area, that share the load of the patch about (x, y) equally."""
        radius_m = self.patch_diameter_m / 2.0 * np.sqrt((np.arange(RADII) + 0.5) / RADII)
        angle = 2.0 * np.pi * (np.arange(ANGLES) + 0.5) / ANGLES
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points: Array = (radius_m[:, None, None] * ring).reshape(-1, 2)
        moved: Array = points + np.array([x_m, y_m])
        return moved
