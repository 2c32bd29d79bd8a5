"""Simulates the magnet of a neighbouring pad, with its own finger, as a simulated pad feels it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array, Placement
from fmfts.simulation.cylinder import cylinder_field
from fmfts.simulation.finger import Finger, columns, finger_of
from fmfts.simulation.mounted import MountedPad
from fmfts.simulation.pad_file import mechanics_of


@dataclass(slots=True)
class NeighbourMagnet:
    """placement: of the magnet's pad, in the axes of the pad that feels it. finger: may be replaced at any time."""

    built: MountedPad
    placement: Placement
    remanence_per_k: float
    finger: Finger

    @classmethod
    def beside(cls, pad: PadConfig, neighbour: PadConfig, source: SimulatedSource) -> Self:
        """The magnet of `neighbour` as `pad` feels it, with a random error of its place. source: of `neighbour`."""
        nominal = neighbour.placement.si().seen_from(pad.placement.si())
        random = seeded(source, f"beside {pad.name}")
        placement = Placement(
            nominal.position_m + random.normal(0.0, nominal.tolerance_m, 3), nominal.rotation, nominal.tolerance_m
        )
        tolerance = neighbour.tolerance.si()
        built = MountedPad.built(
            neighbour.pad(),
            seeded(source, "pad"),
            mechanics_of(neighbour, source),
            tolerance.sensor_rotation_rad,
            tolerance.cross_axis,
        )
        finger = finger_of(source)
        return cls(built, placement, neighbour.magnet.temperature_coefficient_per_k, finger)

    def field(self, place_m: Array, sampled_s: Array, warming_k: float) -> Array:
        """Field (N, 3) in tesla at places (N, 3), in the axes of the pad that feels it, each at its own time (N,)."""
        position_m, axis = self.built.pose(*columns([self.finger(moment) for moment in sampled_s.tolist()]))
        turn, magnet = self.placement.rotation, self.built.pad.magnet
        warm = magnet.with_remanence(magnet.remanence_t * (1.0 + self.remanence_per_k * warming_k))
        return cylinder_field(place_m, self.placement.position_m + position_m @ turn.T, axis @ turn.T, warm)


def seeded(source: SimulatedSource, what: str) -> np.random.Generator:
    """A generator for one purpose, independent of the others: for example, new chips do not change the built pad."""
    return np.random.default_rng([source.seed, *what.encode()])
