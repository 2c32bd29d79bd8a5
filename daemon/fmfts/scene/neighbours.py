"""The neighbours that a pad's configuration names: where their magnets are, and whether they can be felt here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from fmfts.arithmetic.elementary import power
from fmfts.arithmetic.matrix import length, lengths
from fmfts.config import PadConfig, neighbours_of
from fmfts.pad import Placement
from fmfts.pose import State
from fmfts.pose.neighbour import REACH_M, REACH_RAD, NeighbourEstimate, NeighbourView, Sighting


@dataclass(frozen=True, slots=True)
class SceneNeighbour:
    """A neighbouring pad. placement: in this pad's axes. change_t: largest change of the field here, by pressing it.

    noise_t: of one sample here. A neighbour that changes the field by less has no measurable effect (docs/pose.md).
    """

    name: str
    placement: Placement
    distance_m: float
    change_t: float
    noise_t: float

    @property
    def is_felt(self) -> bool:
        return self.change_t > self.noise_t

    @property
    def why(self) -> str:
        chosen = "its magnet is part of the state, at its own pad's last estimate" if self.is_felt else "left out"
        return (
            f"pad '{self.name}' is {self.distance_m * 1e3:.0f} mm away, and pressing it changes the field by up to "
            f"{self.change_t * 1e6:.2g} µT (a sample's noise is {self.noise_t * 1e6:g} µT): {chosen}"
        )


def neighbours_around(pad: PadConfig, pads: Sequence[PadConfig]) -> Iterator[SceneNeighbour]:
    """Yields the neighbours that `pad` names."""
    drawing = pad.pad()
    sensors = drawing.sensors.position_m
    for other in neighbours_of(pad, pads):
        placement, magnet = other.placement.si().seen_from(pad.placement.si()), other.pad().magnet
        place = placement.point(other.pad().rest_position_m)
        distance = float(lengths(sensors - place).min())
        # A step s changes a dipole's field at a distance r by a share of 3s/r, and a turn by a share of its angle.
        change = magnet.strength_t_m3 / power(distance, 3) * (3.0 * REACH_M / distance + REACH_RAD)
        apart = length(place - drawing.rest_position_m)
        yield SceneNeighbour(other.name, placement, apart, change, drawing.chip.noise_t)


def neighbours_at_rest(pad: PadConfig, pads: Sequence[PadConfig]) -> list[NeighbourEstimate]:
    """The neighbours that `pad` names, with the uncertainty of magnets that no pad has observed yet."""
    views = []
    for other in neighbours_of(pad, pads):
        magnet, rest = other.pad().magnet, State.at_rest(other.pad())
        views.append(
            NeighbourView(Sighting.unseen(magnet, rest), other.placement.si().seen_from(pad.placement.si())).at(0)
        )
    return views
