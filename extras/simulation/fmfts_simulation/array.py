"""Simulates a pad with several magnets, and one or two fingers on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmfts.config import PadConfig, SimulatedSource
from fmfts.pad import Array, Pad, SensorArray, rotation_from_vector
from fmfts_simulation.mounted import EARTH_T, GAIN, SENSOR_PLACE_M, MountedPad
from fmfts_simulation.mounted_magnets import FieldOfFingers, MountedMagnets
from fmfts_simulation.source import Simulated


class SimulatedArray(Simulated):
    """A Source of one simulated pad with several magnets."""

    @property
    def inside(self) -> MountedMagnets:
        """The magnets as they were built, for tests."""
        return self.fields.inside

    def _build(
        self, config: PadConfig, source: SimulatedSource, random: np.random.Generator, perfect: bool
    ) -> MountedPad:
        drawing = config.pad()
        self.fields = FieldOfFingers(MountedMagnets.of(config, None if perfect else random))
        if perfect:
            return MountedPad(drawing, np.ones((len(drawing.sensors), 3)), np.zeros(3), np.eye(3))
        sensors, tolerance = drawing.sensors, config.tolerance.si()
        shape = sensors.position_m.shape
        turns = [rotation_from_vector(one) for one in random.normal(0.0, tolerance.sensor_rotation_rad, shape)]
        turned = SensorArray(
            sensors.position_m + random.normal(0.0, SENSOR_PLACE_M, shape), sensors.axes @ np.array(turns)
        )
        upper = np.triu(random.normal(0.0, tolerance.cross_axis, (*shape, 3)), 1)
        ambient = random.standard_normal(3)
        built = Pad(
            drawing.name,
            turned,
            drawing.magnet,
            drawing.rest_position_m,
            drawing.rest_axis,
            drawing.chip,
            drawing.silicone,
        )
        gain = random.normal(1.0, GAIN, shape)
        ambient_t = EARTH_T * ambient / np.linalg.norm(ambient)
        return MountedPad(built, gain, ambient_t, np.eye(3), cross_axis=upper + upper.transpose(0, 2, 1))

    def _magnet_field(self, sampled_s: Array, warming_k: float) -> Array:
        """(N, 3) field of the magnets."""
        warmer = 1.0 + self._magnet_per_k * warming_k
        return self.fields.at(self._built.pad.sensors.position_m, sampled_s, self.fingers, warmer)


def simulated_pad(config: PadConfig, beside: Sequence[PadConfig] = ()) -> Simulated:
    """The simulated source of a pad with one magnet or with several."""
    return SimulatedArray(config, beside) if config.other_magnets else Simulated(config, beside)
