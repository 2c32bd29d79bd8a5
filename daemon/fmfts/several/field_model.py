"""The effect of fingers on the field of a pad with several magnets, and its covariance.

The unknowns are the fingers themselves: x, y and the force of each. The magnets' poses follow from them by the table of
presses (`ArrayResponse`), and the field from the poses. All else that changes the field is not solved but considered:
it widens the covariance of the field, and so the deviations of what is solved (Schmidt 1966):

    C = noise + A A' σ_A² + m m' σ_m² + E E' + P (S S' (μF)² + w w' σ_w² + (ε·change)² + D D' σ_D²) P'

A: the ambient field, along each axis. m: all moments together (temperature). E: the baseline's uncertainty, for this
change of poses (`FieldErrors`). P: the field's slope by the poses; S: the effect of a finger's shear, with a deviation
of μ times its force; w: the effect of a wider or narrower patch; ε: errors of the table, and of adding up fingers. D: a
press's place is relative to the rest of each magnet, which is known to σ_D.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import cholesky
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.common.record import Record
from fmfts.contact.array_response import PRESSED, ArrayResponse, Pressed
from fmfts.pad import Pad
from fmfts.pose.magnets import field_and_slope, field_of
from fmfts.several import _several
from fmfts.several.arrays import doubles, finite, padded, require_room

Array = NDArray[np.float64]

FINGER = 3  # unknowns of one: x and y in mm, and its normal force in N
MM = np.array([1e-3, 1e-3, 1e-3, 1.0, 1.0])  # from the response's units to SI, for each magnet

# A patch that is wider or narrower than the calibrated 6 mm changes the mean of x² over it: by 1.1 mm² for a patch of
# 4 or 8 mm, by 4 mm² for one of 10 mm. Half of that times the Laplacian is the change.
PATCH_MM2 = 1.0
SMALLEST_M = 1e-9
# Adding up fingers errs by 15 µm of 800 at 2 × 0.5 N, by 40 µm at 2 × 1 N (lab/results/several.md): with the product
# of two forces.
SUM_ERROR_PER_N = 0.02


@dataclass(frozen=True, slots=True)
class Scene:
    """Deviations of other causes of a change of field. ambient_t: of the ambient field since the baseline, along each
    axis. moment: relative, of all moments together. friction: shear of a finger over its force. silicone: of the scale
    of all forces, as a share. ambient_walk_t2_per_s: random walk of the ambient field, along each axis."""

    ambient_t: float
    moment: float
    friction: float
    silicone: float = 0.0
    ambient_walk_t2_per_s: float = 0.0


class Predicted(NamedTuple):
    """field (3N,): its change since rest. slope (3N, 3K): by the fingers. by_pose (3N, 5M). change (5M,): of the poses,
    in SI. pressed: what each finger does alone, in the response's units."""

    field_t: Array
    slope: Array
    by_pose: Array
    change: Array
    pressed: tuple[Pressed, ...]


class FieldModel:
    """The fields of one mounted pad under fingers (K, 3): x and y in mm, force in N."""

    def __init__(self, pad: Pad, mounting: ArrayMounting, response: ArrayResponse, scene: Scene) -> None:
        self.pad, self.mounting, self.response, self.scene = pad, mounting, response, scene
        self._si = np.tile(MM, len(mounting.magnets))
        count, causes, terms = len(mounting.sensors), mounting.errors.by_pose.shape[2], response.coefficient.shape[2]
        require_room(magnets=len(mounting.magnets), sensors=count, causes=causes, terms=terms)
        self.at_rest = field_of(mounting.magnets, mounting.sensors).ravel()
        self.by_ambient = mounting.sensors.axes.transpose(0, 2, 1).reshape(3 * count, 3)
        drawn = np.array([one.rest_position_m for one in pad.magnets])
        self._off_mm = (mounting.magnets.position_m - drawn)[:, :2] * 1e3
        place = mounting.rest_covariance.reshape(len(drawn), 6, len(drawn), 6)[:, :2, :, :2]
        self._off_root_mm = 1e3 * cholesky(
            place.reshape(2 * len(drawn), -1) + SMALLEST_M * SMALLEST_M * np.eye(2 * len(drawn))
        )
        self._rest_slope = field_and_slope(mounting.magnets, mounting.frames, mounting.sensors)[1]
        self._pack()

    def in_scene(self, scene: Scene) -> FieldModel:
        """The same pad in another scene, which changes no field, and so no template of a grid."""
        other = copy(self)
        other.scene = scene
        other._pack()
        return other

    def predict(self, fingers: Array) -> Predicted:
        """The change of the field by `fingers` (K, 3)."""
        values, poses, unknowns = len(self.at_rest), len(self._si), FINGER * len(fingers)
        field, slope, by_pose = np.empty(values), np.empty((values, unknowns)), np.empty((values, poses))
        change, pressed = np.empty(poses), np.empty((len(fingers), PRESSED * poses))
        require_room(fingers=len(fingers))
        fingers = doubles(fingers)
        if not _several.predict(self.packed, self.work, fingers, field, slope, by_pose, change, pressed):
            finite(fingers=fingers)
        return Predicted(field, slope, by_pose, change, tuple(map(Pressed.of, pressed)))

    def covariance(self, fingers: Array, predicted: Predicted, variance_t2: Array, ambient_t: Array) -> Array:
        """C (3N, 3N) of the module's docstring. variance_t2 (3N,): of noise. ambient_t (3,): the known change of the
        ambient field, which rotated chips misread."""
        covariance = np.empty((len(self.at_rest), len(self.at_rest)))
        each = [np.concatenate([part.ravel() for part in one]) for one in predicted.pressed]
        pressed = np.concatenate(each) if each else np.empty(0)
        given = doubles(fingers), *map(doubles, predicted[:4]), pressed, doubles(variance_t2), doubles(ambient_t)
        _several.covariance(*self.parts, *given, covariance)
        return covariance

    def _pack(self) -> None:
        """Make the model as several.h reads it, and the work space of C."""
        self.packed, self.work = self._packed(), np.zeros(_several.WORK_BYTES // 8)
        self.parts = self.packed, self.work

    def _packed(self) -> Array:
        mounting, response, scene = self.mounting, self.response, self.scene
        magnets, sensors, errors = mounting.magnets, mounting.sensors, mounting.errors
        head = Record(_several.HEAD)
        head.fill(
            {
                "magnets": len(magnets),
                "sensors": len(sensors),
                "causes": errors.by_pose.shape[2],
                "width": len(response.coefficient),
                "terms": response.coefficient.shape[2],
                "first_mm": response.first_mm,
                "spacing_mm": response.spacing_mm,
                "scale_n": response.scale_n,
                "ambient_t": scene.ambient_t,
                "moment": scene.moment,
                "friction": scene.friction,
                "patch_mm2": PATCH_MM2,
                "response_error": response.error,
                "sum_error_per_n": SUM_ERROR_PER_N,
                "unit": MM,
            }
        )
        parts = [head.flat, magnets.position_m, magnets.strength_t_m3, magnets.octupole_m2, mounting.frames]
        parts += [sensors.position_m, sensors.axes, self.at_rest, self._rest_slope, padded(self.by_ambient.T)]
        parts += [self._off_mm, self._off_root_mm, padded(errors.by_pose.swapaxes(1, 2))]
        parts += [padded(errors.by_field.transpose(1, 2, 0))]
        parts += [response.table]
        return np.concatenate([np.ravel(part) for part in parts])
