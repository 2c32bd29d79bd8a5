"""Simulates how silicone differs from a spring: it creeps under a load, recovers slowly, and has hysteresis.

Linear viscoelasticity: a load held since time 0 moves the magnet by J(t) times the way of a spring, J(t) = 1 + Σ c
(1 − exp(−t/τ)), a Prony series with one term for each decade of time. Equal terms have a loss tangent of about
(π/2) c / ln 10 at all frequencies (H. C. Booij and G. P. J. M. Thoone, "Generalization of Kramers-Kronig transforms",
Rheol. Acta 21 (1982) 15). A Prony series of Sylgard 184 from dynamic tests: M. Kunzemann et al., arXiv 2402.07555.
Published figures spread widely with filler, cure and age. Ours is a round one, 2 % a decade: a loss tangent of 0.014.
"""

from __future__ import annotations

import numpy as np

from fmfts.pad import Array

CREEP_PER_DECADE = 0.02
TIMES_S = np.array([0.1, 1.0, 10.0, 100.0, 1000.0])
# A table of presses holds what a calibration measures, so long after the load: [collect] settle_s and average_s.
MEASURED_S = 0.5
# Half the difference between loading and unloading, besides creep: the same loss as that of one decade of creep.
HYSTERESIS = 0.01
# The share of the way back on which the other branch is reached.
REVERSAL = 0.1
LEAST_WAY = 1e-9  # m and rad: less is no way


class Silicone:
    """The memory of one pad's silicone, followed at the sample times of each of N sensors.

    creep_per_decade: how much further a held load moves the magnet, for each tenfold of time.
    """

    def __init__(
        self, sensors: int, creep_per_decade: float = CREEP_PER_DECADE, hysteresis: float = HYSTERESIS
    ) -> None:
        self._creep, self._hysteresis = creep_per_decade, hysteresis
        self._settled = 1.0 + creep_per_decade * float(np.sum(1.0 - np.exp(-MEASURED_S / TIMES_S)))
        self._slow = np.zeros((len(TIMES_S), sensors, 5))
        self._time_s = np.full(sensors, np.nan)
        self._before = np.zeros((sensors, 5))
        self._branch = np.zeros(sensors)  # 1: being loaded, -1: being unloaded

    def moved(self, time_s: Array, response: Array) -> Array:
        """The magnet's movement (K, N, 5) where a spring's is `response` (K, N, 5), at each sensor's times (K, N)."""
        return np.array([self._next(*each) for each in zip(time_s, response, strict=True)])

    def _next(self, time_s: Array, response: Array) -> Array:
        elapsed_s = np.nan_to_num(np.maximum(time_s - self._time_s, 0.0))
        self._time_s = time_s
        remaining = np.exp(-elapsed_s / TIMES_S[:, None])[:, :, None]
        # Exact for a movement that is even between two samples.
        self._slow = remaining * self._slow + (1.0 - remaining) * (self._before + response) / 2.0
        self._turn_back(response)
        self._before = response
        crept = response + self._creep * self._slow.sum(axis=0)
        return np.asarray(crept / self._settled * (1.0 - self._hysteresis * self._branch[:, None]))

    def _turn_back(self, response: Array) -> None:
        way, before = np.linalg.norm(response[:, :3], axis=1), np.linalg.norm(self._before[:, :3], axis=1)
        step = way - before
        share = np.minimum(np.abs(step) / np.maximum(REVERSAL * np.maximum(way, before), LEAST_WAY), 1.0)
        self._branch += share * (np.sign(step) - self._branch)
