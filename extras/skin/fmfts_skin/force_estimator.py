"""One pad whose magnets are unknown: field → force in three directions, by polynomials (contact/force_model.py).

The change of the field since the rest recording, over the size of the rest, is what the polynomials were made from. A
frame adds its own errors: the chips' noise, the slow drift of the rest, the ambient field in which the robot turns.
Each goes through the polynomial's slope into the deviations, beside the model's own, which no average over frames
reduces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import power
from fmfts.arithmetic.matrix import SingularError, cholesky, product, solve_lower
from fmfts.baseline.rest_field import RestField
from fmfts.common.chi2 import quantile
from fmfts.pad import Pad
from fmfts.pose import Aligned
from fmfts_skin.estimator import (
    FALSE_CONTACTS_PER_HOUR,
    FREE_FIELD,
    KEEPS,
    REST_UT,
    SkinMemory,
    SkinReading,
)
from fmfts_skin.model import SkinForceModel

Array = NDArray[np.float64]
DIRECTIONS = 3
# Presses of the calibration have up to 1. A foreign field resembles none of them: 5 µT from sensor to sensor have 9 on
# the standard pad, 20 µT at one sensor 30.
FARTHEST_LEVERAGE = 4.0
NO_PRESS = (
    "no press of the calibration changes the field so: steel or a magnet nearby, a turned robot, or a rest that is no "
    "longer so: `fmfts-daemon baseline --rest`"
)
HARDER = 1.1
LEAST_NORMAL_N2 = 1e-12  # keeps the test for a touch regular


@dataclass
class ForceEstimator:
    """Field → force of a pad that has a rest recording. As SkinEstimator, but there is no place."""

    pad: Pad
    mounting: RestField
    model: SkinForceModel
    ambient_t: float
    rate_hz: float
    repeats_allowed: Array
    magnet_per_k: float
    memory: SkinMemory = field(init=False)

    def __post_init__(self) -> None:
        self.memory = SkinMemory(np.zeros(DIRECTIONS), last_c=self.mounting.temperature_c)
        self._values = self.model.values()
        self._rest_t = self.mounting.rest_t.ravel()[self._values]
        self._scale_t = float(np.sqrt(product(self._rest_t, self._rest_t) / len(self._rest_t)))
        ambient = self.ambient_t * self.pad.sensors.axes.transpose(0, 2, 1).reshape(-1, FREE_FIELD)[self._values]
        noise_t = self.mounting.noise_t.ravel()[self._values]
        drift_t = REST_UT * 1e-6
        errors = product(ambient, ambient.T) + np.diag(noise_t * noise_t + drift_t * drift_t)
        self._covariance = errors / (self._scale_t * self._scale_t)
        self._touch = quantile(min(FALSE_CONTACTS_PER_HOUR / (3600.0 * self.rate_hz), 0.01), DIRECTIONS)
        self._sign = np.array([1.0, 1.0, self.model.forces.pressed_z])

    def forget_touch(self) -> None:
        self.memory.touching = False

    def read(self, aligned: Aligned, temperature_c: float | None, missing: Mapping[int, str]) -> SkinReading:
        """Judge one aligned frame. missing: what is wrong with sensors that cannot be used."""
        memory = self.memory
        memory.see(aligned, temperature_c, self.rate_hz)
        used = np.isfinite(aligned.field_t) & (aligned.repeats <= self.repeats_allowed)
        told = [f"sensor {sensor + 1} is {why}" for sensor, why in missing.items()]
        known = used.ravel()[self._values]
        try:
            return self._judged(np.where(known, self._change(aligned), np.nan), used, told)
        except SingularError:
            memory.touching = False
            return SkinReading("lost", "the values that are left tell no force", used)

    def _change(self, aligned: Aligned) -> Array:
        """(V,) the change of the field since the rest recording, at that recording's temperature, over the rest."""
        stronger = self.memory.stronger(self.mounting.temperature_c, self.magnet_per_k)
        change: Array = (aligned.field_t.ravel()[self._values] / stronger - self._rest_t) / self._scale_t
        return change

    def _judged(self, change: Array, used: NDArray[np.bool_], told: list[str]) -> SkinReading:
        memory, known = self.memory, np.isfinite(change)
        polynomial = self.model.forces.map_of(known)
        if polynomial is None:
            memory.touching = False
            only = f"the model tells no force from the {int(known.sum())} values that are left"
            return SkinReading("lost", "; ".join([only, *told]), used)
        found = self.model.forces.find(change[None])
        slope = polynomial.slope(np.where(known, change, 0.0))
        by_frame = product(slope.T, self._covariance, slope)
        white = solve_lower(cholesky(by_frame + LEAST_NORMAL_N2 * np.eye(DIRECTIONS)), found.force[0])
        memory.touching = float(product(white, white)) > self._touch * (KEEPS if memory.touching else 1.0)
        whole = bool(known.all())
        reason = "; ".join(told) or ("" if whole else "axes are saturated or stuck, and are left out")
        if not memory.touching:
            return SkinReading("ok" if whole else "degraded", reason, used, touching=False)
        memory.contact = found.force[0] * self._sign
        deviation = np.sqrt(found.variance[0] + np.diagonal(by_frame))
        size = float(np.sqrt(product(found.force[0], found.force[0]))) / self.model.forces.largest_n
        # The field grows a little faster than the force, and the largest monomials with its power.
        if found.leverage[0] > FARTHEST_LEVERAGE * power(max(size, 1.0), 2 * (polynomial.power + 1)):
            memory.touching = False
            return SkinReading("disturbed", NO_PRESS, used)
        return SkinReading("ok" if whole else "degraded", reason, used, True, memory.contact, deviation, size > HARDER)
