"""A pad with several magnets under fingers: docs/several.md, and the equations at the head of several/field_model.py.

change = Σ_ij β(x − i)β(y − j)(Σ_t c_ijt F^(t+1) + Σ_a s_ija S_a), β the cubic cardinal B-spline (SciPy's). The magnets
move by that in m and in components of the axis, in axes in which each points along +z; a press counts from the
drawing's place of each magnet, which lies off the real one. The field is that of field.py. Considered causes widen:
C = noise + A A'σ_A² + m m'σ_m² + E E' + P(S S'(μF)² + w w'σ_w² + (ε·change)² + D D'σ_D²)P'. Derivatives by differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import BSpline

from oracle.field import Array, OneMagnet, differences, field

CARDINAL = BSpline.basis_element(np.arange(-2.0, 3.0), extrapolate=False)
TO_SI = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0])
PATCH_MM2, SUM_ERROR_PER_N = 1.0, 0.02  # docs: half of a patch's mean x² is 1.1 mm²; 40 µm of 800 at 2 × 1 N
# Of a change of pose in m and components of an axis, and of fingers in mm and N: close enough, and above rounding.
POSE_STEP, FINGER_STEP = np.array([2e-6, 2e-6, 2e-6, 2e-4, 2e-4]), np.array([1e-2, 1e-2, 1e-3])


def weights(response: Any, along_mm: float) -> Array:
    knots = response.first_mm + response.spacing_mm * (np.arange(len(response.coefficient)) - 1.0)
    return np.nan_to_num(CARDINAL((along_mm - knots) / response.spacing_mm))


@dataclass(frozen=True, slots=True)
class Pad:
    """model: the product's; only its numbers are read, and no function is called except for the baseline's errors."""

    model: Any
    drawn_m: Array

    @property
    def count(self) -> int:
        return len(self.model.mounting.magnets)

    def alone(self, finger: Array) -> Array:
        """(5M,) what one finger does by the table, in the table's units."""
        response = self.model.response
        x, y, force = finger
        both = np.outer(weights(response, x), weights(response, y))
        powers = force ** np.arange(1.0, response.coefficient.shape[2] + 1.0)
        return np.asarray(np.einsum("ij,ijtp,t->p", both, response.coefficient, powers))

    def change(self, fingers: Array) -> Array:
        """(5M,) in SI."""
        off_mm = (self.model.mounting.magnets.position_m - self.drawn_m)[:, :2] * 1e3
        total = np.zeros(5 * self.count)
        for finger in fingers:
            slope = differences(self.alone, finger, FINGER_STEP).reshape(self.count, 5, 3)
            total += self.alone(finger)
            total -= (slope[:, :, 0] * off_mm[:, :1] + slope[:, :, 1] * off_mm[:, 1:]).ravel()
        return total * np.tile(TO_SI, self.count)

    def field_t(self, change: Array) -> Array:
        """The field (3N,) along the sensors' axes."""
        mounting = self.model.mounting
        total = np.zeros(mounting.sensors.position_m.shape)
        for number, moved in enumerate(change.reshape(-1, 5)):
            up = np.sqrt(1.0 - moved[3] ** 2 - moved[4] ** 2)
            axis = mounting.frames[number] @ np.array([moved[3], moved[4], up])
            place = mounting.magnets.position_m[number] + moved[:3]
            strength, kappa = mounting.magnets.strength_t_m3[number], mounting.magnets.octupole_m2[number]
            total += field(OneMagnet(place, axis, 0.0, strength, kappa), mounting.sensors.position_m)
        return np.asarray(np.einsum("nij,ni->nj", mounting.sensors.axes, total).ravel())

    def by_pose(self, change: Array) -> Array:
        return differences(self.field_t, change, np.tile(POSE_STEP, self.count))

    def by_finger(self, fingers: Array) -> Array:
        """(3N, 3K) by the table's own slope: a magnet's offset is a second-order effect."""
        slopes = [differences(self.alone, finger, FINGER_STEP) for finger in fingers]
        return self.by_pose(self.change(fingers)) @ (
            np.concatenate(slopes, axis=1) * np.tile(TO_SI, self.count)[:, None]
        )

    def covariance(self, fingers: Array, variance_t2: Array, ambient_t: Array) -> Array:
        model, scene = self.model, self.model.scene
        mounting, change = model.mounting, self.change(fingers)
        A = mounting.sensors.axes.transpose(0, 2, 1).reshape(-1, 3)
        m = self.field_t(change)[:, None]
        E = mounting.errors.at(change, ambient_t)
        total = np.diag(variance_t2) + scene.ambient_t**2 * A @ A.T + scene.moment**2 * m @ m.T + E @ E.T
        if not len(fingers):
            return np.asarray(total)
        P = self.by_pose(change)
        return np.asarray(total + P @ self.considered(fingers) @ P.T)

    def considered(self, fingers: Array) -> Array:
        """(5M, 5M) in SI: the changes of pose that place and force of a finger do not determine."""
        mounting, response, scene = self.model.mounting, self.model.response, self.model.scene
        inner, by_place, table = (
            np.zeros((5 * self.count,) * 2),
            np.zeros((5 * self.count, 2 * self.count)),
            np.zeros(5 * self.count),
        )
        alone = [self.alone(finger) for finger in fingers]
        for number, finger in enumerate(fingers):
            x, y, force = finger
            both = np.outer(weights(response, x), weights(response, y))
            S = np.einsum("ij,ijap->pa", both, response.shear)
            w = 0.5 * PATCH_MM2 * sum(self._curvature(finger, axis) for axis in range(2))
            inner += (scene.friction * force) ** 2 * S @ S.T + np.outer(w, w)
            slope = differences(self.alone, finger, FINGER_STEP).reshape(self.count, 5, 3)
            for magnet in range(self.count):
                by_place[5 * magnet : 5 * magnet + 5, 2 * magnet : 2 * magnet + 2] -= slope[magnet, :, :2]
            table += (response.error * alone[number]) ** 2
            for other in range(number):
                pair = np.abs(alone[number]) * fingers[other, 2] + np.abs(alone[other]) * force
                table += (0.5 * SUM_ERROR_PER_N * pair) ** 2
        places = [6 * magnet + axis for magnet in range(self.count) for axis in range(2)]
        place_mm2 = 1e6 * mounting.rest_covariance[np.ix_(places, places)]
        inner += by_place @ place_mm2 @ by_place.T + np.diag(table)
        to_si = np.tile(TO_SI, self.count)
        return np.asarray(inner * to_si * to_si[:, None])

    def _curvature(self, finger: Array, axis: int) -> Array:
        step = np.zeros(3)
        step[axis] = 1e-2
        return np.asarray((self.alone(finger + step) - 2.0 * self.alone(finger) + self.alone(finger - step)) / 1e-4)
