"""One pad whose magnets are unknown: field → force in three directions, by polynomials (force_model.py).

The change of the field since the rest recording, over the size of the rest, is what the polynomials were made from. A
frame adds its own errors: the chips' noise, the slow drift of the rest, the ambient field in which the robot turns.
Each goes through the polynomial's slope into the deviations, beside the model's own, which no average over frames
reduces. A model of both routes also takes the pose of the pad's one magnet, which each frame's field determines.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import power
from fmfts.arithmetic.matrix import cholesky, product, solve_lower
from fmfts_skin.force_model import DIRECTIONS
from fmfts_skin.model import SkinForceModel
from fmfts_skin.pose_values import PoseValues
from fmfts_skin.rested import REST_UT, Array, Mask, RestedPad, SkinReading, health_of

Indices = NDArray[np.intp]

# Presses of the calibration reach at most 1. A foreign field resembles no press: 5 µT from sensor to sensor give 9 on
# the standard pad, 20 µT at one sensor gives 30.
FARTHEST_LEVERAGE = 4.0
NO_PRESS = (
    "no press of the calibration changes the field so: steel or a magnet nearby, a turned robot, or a rest that is no "
    "longer so: `fmfts-daemon baseline --rest`"
)
HARDER = 1.1
STEP_UT = 5.0  # of a value, for the slope of the pose: far above rounding, far below a press
LEAST_NORMAL_N2 = 1e-12  # keeps the test for a touch regular


@dataclass
class ForceEstimator(RestedPad):
    """Field → force; there is no place. poses: of the magnet, for a model of both routes."""

    model: SkinForceModel
    poses: PoseValues | None = None
    untold = "the remaining values do not determine the force"
    _values: Indices = field(init=False)

    def __post_init__(self) -> None:
        self.watch(DIRECTIONS)
        self._values = self.model.values()
        self._rest_t = self.mounting.rest_t.ravel()[self._values]
        self._scale_t = float(np.sqrt(product(self._rest_t, self._rest_t) / len(self._rest_t)))
        ambient = self.ambient_t * self._by_ambient()[self._values]
        noise_t = self.mounting.noise_t.ravel()[self._values]
        drift_t = REST_UT * 1e-6
        errors = product(ambient, ambient.T) + np.diag(noise_t * noise_t + drift_t * drift_t)
        self._covariance = errors / (self._scale_t * self._scale_t)
        self._sign = np.array([1.0, 1.0, self.model.forces.pressed_z])

    def _change(self, field_t: Array) -> Array:
        """(V,) the change of the field since the rest recording, at that recording's temperature, over the rest."""
        change: Array = (self._as_at_rest(field_t.ravel()[self._values]) - self._rest_t) / self._scale_t
        return change

    @property
    def _errors(self) -> Array:
        """(V, V) covariance of the change of one frame."""
        errors: Array = self._covariance
        if self._foreign_t2 is None:
            return errors
        values = self._foreign_t2[np.ix_(self._values, self._values)]
        return errors + values / (self._scale_t * self._scale_t)

    def _by_pose(self, field_t: Array, change: Array) -> tuple[Array, Array]:
        """The model's values (V,), and their slope by the field's change (V, C). change (C,): NaN where not known."""
        if self.poses is None:
            return change, np.eye(len(change))
        used_t = np.full(field_t.size, np.nan)
        used_t[self._values] = np.where(np.isfinite(change), self._as_at_rest(field_t.ravel()[self._values]), np.nan)
        pose, slope = self.poses.found(used_t.reshape(field_t.shape), STEP_UT * 1e-6)
        slope = self._scale_t * np.where(np.isfinite(slope[:, self._values]), slope[:, self._values], 0.0)
        return np.concatenate([change, pose]), np.concatenate([np.eye(len(change)), slope])

    def _judged(self, field_t: Array, used: Mask, told: list[str]) -> SkinReading:
        memory, change = self.memory, np.where(used.ravel()[self._values], self._change(field_t), np.nan)
        known = np.isfinite(change)
        values, by_change = self._by_pose(field_t, change)
        maps = self.model.forces.maps_of(np.isfinite(values))
        if not maps:
            only = f"the {int(known.sum())} remaining values do not determine the force"
            return self._none("lost", "; ".join([only, *told]), used)
        found = self.model.forces.find(values[None])
        slope = product(by_change.T, self.model.forces.slope(values))
        by_frame = product(slope.T, self._errors, slope)
        white = solve_lower(cholesky(by_frame + LEAST_NORMAL_N2 * np.eye(DIRECTIONS)), found.force[0])
        memory.touching = float(product(white, white)) > self._needed_chi2
        health, reason = health_of(bool(known.all()), told)
        if not memory.touching:
            return SkinReading(health, reason, used, touching=False)
        memory.contact = found.force[0] * self._sign
        deviation = np.sqrt(found.variance[0] + np.diagonal(by_frame))
        size = float(np.sqrt(product(found.force[0], found.force[0]))) / self.model.forces.largest_n
        # The field grows a little faster than the force, and the largest monomials grow with its power.
        most = max(one.power for one in maps)
        if found.leverage[0] > FARTHEST_LEVERAGE * power(max(size, 1.0), 2 * (most + 1)):
            return self._none("disturbed", NO_PRESS, used)
        return SkinReading(health, reason, used, True, memory.contact, deviation, size > HARDER)
