"""The neighbours that a pad's configuration names: the places of their magnets, and whether this pad measures them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fmfts.arithmetic.elementary import power
from fmfts.arithmetic.matrix import lengths
from fmfts.config import PadConfig, neighbours_of
from fmfts.pad import Placement
from fmfts.pose._alignment import REACH_M, REACH_RAD


@dataclass(frozen=True, slots=True)
class SceneNeighbour:
    """A neighbouring pad. placement: in this pad's axes. change_t: largest change of the field here, by pressing it.

    noise_t: of one sample here. A neighbour that changes the field by less has no measurable effect (docs/pose.md).
    """

    name: str
    placement: Placement
    magnets: int
    distance_m: float
    change_t: float
    noise_t: float

    @property
    def is_felt(self) -> bool:
        return self.change_t > self.noise_t

    @property
    def why(self) -> str:
        whose = "its magnet counts" if self.magnets == 1 else f"its {self.magnets} magnets count"
        chosen = f"{whose}, as its own pad saw it last" if self.is_felt else "left out"
        return (
            f"pad '{self.name}' is {self.distance_m * 1e3:.0f} mm away, and pressing it changes the field by up to "
            f"{self.change_t * 1e6:.2g} µT (a sample's noise is {self.noise_t * 1e6:g} µT): {chosen}"
        )


def neighbours_around(pad: PadConfig, pads: Sequence[PadConfig]) -> Iterator[SceneNeighbour]:
    """Yields the neighbours that `pad` names."""
    drawing = pad.pad()
    own = np.array([one.rest_position_m for one in drawing.magnets])
    for other in neighbours_of(pad, pads):
        placement, magnets = other.placement.si().seen_from(pad.placement.si()), other.pad().magnets
        places = [placement.point(one.rest_position_m) for one in magnets]
        changes = []
        for one, place in zip(magnets, places, strict=True):
            distance = float(lengths(drawing.sensors.position_m - place).min())
            # A step s changes a dipole's field at a distance r by a share of 3s/r, and a turn by a share of its angle.
            share = 3.0 * REACH_M / distance + REACH_RAD
            changes.append(one.magnet.strength_t_m3 / power(distance, 3) * share)
        apart = min(float(lengths(own - place).min()) for place in places)
        yield SceneNeighbour(other.name, placement, len(magnets), apart, sum(changes), drawing.chip.noise_t)
