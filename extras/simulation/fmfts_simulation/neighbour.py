"""Simulates the magnets of a neighbouring pad, with its own fingers, as a simulated pad measures them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array, Placement
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.finger import Finger, columns, fingers_of
from fmfts_simulation.mounted import MountedPad, with_chips_turned
from fmfts_simulation.mounted_magnets import FieldOfFingers, MountedMagnets
from fmfts_simulation.pad_file import mechanics_of


@dataclass(slots=True)
class OneMagnet:
    """placement: of the magnet's pad, in the axes of the measuring pad. The fingers may be replaced at any time; such a
    pad has no second finger."""

    built: MountedPad
    placement: Placement
    remanence_per_k: float
    finger: Finger
    second_finger: Finger | None = None

    def field(self, place_m: Array, sampled_s: Array, warming_k: float) -> Array:
        """Field (N, 3) in tesla at places (N, 3), in the axes of the measuring pad, each at its own time (N,)."""
        position_m, axis = self.built.pose(*columns([self.finger(moment) for moment in sampled_s.tolist()]))
        turn, magnet = self.placement.rotation, self.built.pad.magnet
        warm = magnet.with_remanence(magnet.remanence_t * (1.0 + self.remanence_per_k * warming_k))
        return cylinder_field(place_m, self.placement.position_m + position_m @ turn.T, axis @ turn.T, warm)


@dataclass(slots=True)
class SeveralMagnets:
    """Like OneMagnet, for a pad with several."""

    inside: FieldOfFingers
    placement: Placement
    remanence_per_k: float
    finger: Finger
    second_finger: Finger | None

    def field(self, place_m: Array, sampled_s: Array, warming_k: float) -> Array:
        """As OneMagnet.field."""
        turn, fingers = self.placement.rotation, [each for each in (self.finger, self.second_finger) if each]
        there_m = (place_m - self.placement.position_m) @ turn
        field_t: Array = self.inside.at(there_m, sampled_s, fingers, 1.0 + self.remanence_per_k * warming_k) @ turn.T
        return field_t


NeighbourMagnets = OneMagnet | SeveralMagnets


def neighbour_of(pad: PadConfig, neighbour: PadConfig, source: SimulatedSource) -> NeighbourMagnets:
    """The magnets of `neighbour` as `pad` measures them, with a random error of its place. source: of `neighbour`.

    ValueError where no such pad is simulated.
    """
    nominal = neighbour.placement.si().seen_from(pad.placement.si())
    random = seeded(source, f"beside {pad.name}")
    placement = Placement(
        nominal.position_m + random.normal(0.0, nominal.tolerance_m, 3), nominal.rotation, nominal.tolerance_m
    )
    per_k, fingers = neighbour.magnet.temperature_coefficient_per_k, fingers_of(source)
    if neighbour.other_magnets:
        inside = FieldOfFingers(MountedMagnets.of(neighbour, seeded(source, "pad")))
        return SeveralMagnets(inside, placement, per_k, *fingers)
    tolerance = neighbour.tolerance.si()
    built = MountedPad.built(
        neighbour.pad(),
        seeded(source, "pad"),
        mechanics_of(neighbour, source),
        with_chips_turned(tolerance.sensor_rotation_rad, tolerance.cross_axis),
    )
    return OneMagnet(built, placement, per_k, *fingers)


def seeded(source: SimulatedSource, what: str) -> np.random.Generator:
    """A generator for one purpose, independent of the others: for example, new chips do not change the built pad."""
    return np.random.default_rng([source.seed, *what.encode()])
