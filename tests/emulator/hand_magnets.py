"""A hand that moves past a pad: magnets of motors and of another finger, as point dipoles on two joints.

The dipole's field is Jackson's (Classical Electrodynamics, 5.56); the finger is two rigid links in one plane. It shares
nothing with the daemon.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MU0_OVER_4PI = 1e-7
NAMES = ("knuckle", "middle", "still")


@dataclass(frozen=True)
class HandMagnets:
    """Magnets that two joints move. `field` replaces a Source's neighbours.

    moment_am2: of the finger's magnet; the motor's is half. period_s: of the knuckle; the other joint's is longer.
    stiff: the joints keep their initial position.
    """

    moment_am2: float = 0.02
    period_s: float = 4.0
    base_m: tuple[float, float, float] = (0.045, 0.005, -0.01)
    links_m: tuple[float, float] = (0.035, 0.025)
    since_s: float = 0.0

    def joints_rad(self, time_s: float) -> dict[str, float]:
        knuckle, middle = self._moved_rad(np.array([time_s]))
        return dict(zip(NAMES, (float(knuckle[0]), float(middle[0]), 0.7), strict=True))

    def _moved_rad(self, times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        moved = np.maximum(times_s - self.since_s, 0.0)
        knuckle = 1.2 + 0.45 * (1.0 - np.cos(2.0 * np.pi * moved / self.period_s))
        middle = 0.2 + 0.35 * (1.0 - np.cos(2.0 * np.pi * moved / (1.7 * self.period_s)))
        return knuckle, middle

    def dipoles(self, times_s: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Place in m and moment in A·m² of each magnet at each time (N, 3), in the pad's axes."""
        first, middle = self._moved_rad(times_s)
        second, none = first + middle, np.zeros(len(times_s))
        along = np.column_stack([np.cos(first), none, np.sin(first)])
        tip = np.column_stack([np.cos(second), none, np.sin(second)])
        knuckle = np.array(self.base_m) + self.links_m[0] * along
        across = np.column_stack([-np.sin(second), none, np.cos(second)])
        motor = 0.5 * self.moment_am2 * np.column_stack([along[:, 2], none + 0.3, -along[:, 0]])
        return [(knuckle, motor), (knuckle + self.links_m[1] * tip, self.moment_am2 * across)]

    def field(self, position_m: np.ndarray, sampled_s: np.ndarray, warming_k: float = 0.0) -> np.ndarray:
        """(N, 3) T at places (N, 3), each at its own time (N,)."""
        out = np.zeros(position_m.shape)
        for magnet_m, moment in self.dipoles(sampled_s):
            away = position_m - magnet_m
            distance = np.sqrt((away * away).sum(axis=1))[:, None]
            unit = away / distance
            out += MU0_OVER_4PI * (3.0 * unit * (unit * moment).sum(axis=1)[:, None] - moment) / distance**3
        return out
