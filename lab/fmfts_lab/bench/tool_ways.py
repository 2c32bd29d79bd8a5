"""The paths of a magnetic tool beside a pad, and its dipole field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fmfts.pad import Array

# The tool is far away until BEGIN_S, and the simulation ends where it is FAR_M away.
BEGIN_S, FAR_M = 1.0, 0.3


@dataclass(frozen=True, slots=True)
class Way:
    """The path of a tool. nearest_m: from the pad's middle. speed_m_s: along the way; a tool that is put down stays."""

    kind: Literal["passes", "put down", "turned"]
    nearest_m: float
    speed_m_s: float

    @property
    def label(self) -> str:
        return f"{self.kind} {self.nearest_m * 1e3:.0f} mm {self.speed_m_s:.2g} m/s"

    @property
    def seconds(self) -> float:
        """The time until the tool is as far away as in the beginning, or has stayed for two seconds."""
        if self.kind == "turned":
            return BEGIN_S + 4.0
        passing = (2.0 if self.kind == "passes" else 1.0) * (FAR_M - self.nearest_m) / self.speed_m_s
        return BEGIN_S + passing + (0.5 if self.kind == "passes" else 2.0)

    def place_m(self, time_s: Array, sideways: Array, towards: Array) -> Array:
        """(…, 3) where the tool is. sideways, towards (3,): unit vectors at a right angle, of the pad's axes."""
        moved = self.speed_m_s * np.maximum(time_s - BEGIN_S, 0.0)[..., None]
        if self.kind == "passes":
            return np.asarray((moved - (FAR_M - self.nearest_m)) * sideways + self.nearest_m * towards)
        if self.kind == "put down":
            return np.asarray(np.maximum(FAR_M - moved, self.nearest_m) * towards)
        return np.asarray(self.nearest_m * towards + 0.0 * moved)


WAYS = (
    *(Way("passes", nearest_m, speed) for nearest_m in (0.045, 0.09, 0.15) for speed in (0.05, 0.3)),
    *(Way("put down", nearest_m, speed) for nearest_m in (0.06, 0.1, 0.15, 0.22) for speed in (0.05, 1.0)),
    *(Way("turned", nearest_m, 0.0) for nearest_m in (0.1, 0.2)),
)


class Tool:
    """A dipole on its path, from a random side and with a random direction."""

    def __init__(self, way: Way, moment_a_m2: float, random: np.random.Generator) -> None:
        self._way = way
        towards = random.standard_normal(3)
        towards[2] = abs(towards[2])  # the pad's board and its mount are below
        self._towards = towards / np.linalg.norm(towards)
        sideways = np.cross(self._towards, random.standard_normal(3))
        self._sideways = sideways / np.linalg.norm(sideways)
        moment = random.standard_normal(3)
        self._moment_t_m3 = 1e-7 * moment_a_m2 * moment / np.linalg.norm(moment)
        self._about = np.cross(moment, random.standard_normal(3))
        self._about /= np.linalg.norm(self._about)

    def field_t(self, places_m: Array, time_s: Array) -> Array:
        """The field (K, N, 3) at the sensors' places (N, 3), each at its own time (K, N)."""
        moment = np.broadcast_to(self._moment_t_m3, (*time_s.shape, 3))
        if self._way.kind == "turned":  # once in two seconds, about an axis across the moment
            angle = np.pi * np.maximum(time_s - BEGIN_S, 0.0)[..., None]
            moment = np.cos(angle) * moment + np.sin(angle) * np.cross(self._about, moment)
        r = places_m - self._way.place_m(time_s, self._sideways, self._towards)
        square = np.sum(r * r, axis=-1, keepdims=True)
        along = np.sum(r * moment, axis=-1, keepdims=True)
        field_t: Array = (3.0 * along * r / square - moment) / square**1.5
        return field_t
