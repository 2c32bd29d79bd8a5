"""The pose of one known magnet as values of a force model: its change from rest over the scale of the rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fmfts.arithmetic.matrix import product
from fmfts.baseline import Mounting
from fmfts.pad import Array, Pad
from fmfts_calibrate.tracked import FrameSolver, Scene

NAMES = ("a", "b", "c", "m", "n")
# A magnet that moves by a share of its height changes the field by three times that share.
FIELD_BY_HEIGHT = 3.0


def unit_of(height: float) -> Array:
    """(5,) the scale of each value. height: of the magnet over the sensors, in the unit of the positions."""
    return np.array([height / FIELD_BY_HEIGHT] * 3 + [1.0, 1.0])


@dataclass(slots=True)
class PoseValues:
    """rest_t (N, 3): the field at rest, NaN at axes that the model's chips do not have. noise_t: of a value."""

    pad: Pad
    rest_t: Array
    scene: Scene
    noise_t: float
    mounting: Mounting | None
    solver: FrameSolver = field(init=False)
    _unit: Array = field(init=False)

    def __post_init__(self) -> None:
        self.solver = FrameSolver(self.pad, self.rest_t, self.scene, self.noise_t, self.mounting)
        away_mm = 1e3 * (self.pad.rest_position_m - self.pad.sensors.position_m.mean(axis=0))
        self._unit = unit_of(float(np.sqrt(product(away_mm, away_mm))))

    def find(self, measured_t: Array, bound_t: Array) -> Array:
        """(K, 5) of fields (K, N, 3); NaN where these determine no pose. bound_t: as FrameSolver.solved."""
        pose = self.solver.solved_if_possible(self._magnets(measured_t), self._magnets(bound_t))
        return np.asarray((pose[:, :5] - self.solver.rest_pose[:5]) / self._unit)

    def found(self, measured_t: Array, step_t: float) -> tuple[Array, Array]:
        """(5,) of one frame (N, 3), and (5, 3N): its slope by each value, in 1/T; 0 by values that are not there."""
        values = measured_t.ravel()
        stepped = values + step_t * np.concatenate([np.zeros((1, len(values))), np.eye(len(values))])
        fields = stepped.reshape(-1, *measured_t.shape)
        found = self.find(fields, np.full(fields.shape, np.nan))
        return found[0], np.where(np.isfinite(values), (found[1:] - found[0]).T / step_t, 0.0)

    def _magnets(self, measured_t: Array) -> Array:
        if self.mounting is None:
            return measured_t
        return np.array([self.mounting.magnet_field(one) for one in measured_t])
