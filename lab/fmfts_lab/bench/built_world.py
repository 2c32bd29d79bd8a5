"""A world of its own for pads as people build them: it shares no assumption with the daemon's simulation.

Exact rotations of the chips, cross-axis sensitivities, offsets, gains, places, tilt and strength of the magnet; and the
Earth's field of a workshop, whose strength depends on the attitude.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from fmfts.baseline.request import TURN_S
from fmfts.config import PadConfig, ToleranceConfig
from fmfts.pad import Array, Pad, SensorArray
from fmfts.sensor.frame import WireFrame
from fmfts_lab.bench.stated_world import StatedMechanics
from fmfts_lab.bench.tapped import ManyFrames
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.finger import Touch, columns
from fmfts_simulation.mounted import MountedPad

RATE_HZ = 220
EARTH_T, UNEVEN, GRADIENT_T = 0.5e-4, 0.005, 5e-8
CROSS_AXIS, OFFSET_T, REMANENCE = 0.002, 1e-6, 0.05
TURNING_DEG_PER_S = 20.0
X, Y, Z = np.eye(3)


@dataclass(frozen=True, slots=True)
class Defects:
    """The defects of a pad in one row of the table; standard deviations.

    stated: all else is drawn from the default tolerances, silicone and fingers, too.
    """

    rotation_deg: float
    gain: float
    turning: bool
    stated: bool = False

    @property
    def cross_axis(self) -> float:
        return ToleranceConfig().cross_axis if self.stated else CROSS_AXIS

    @property
    def remanence(self) -> float:
        return ToleranceConfig().remanence if self.stated else REMANENCE

    @property
    def magnet_tilt_deg(self) -> float:
        """The tilt of the magnet in its silicone, without that of the whole pad."""
        return ToleranceConfig().magnet_tilt_deg if self.stated else 0.0

    @property
    def label(self) -> str:
        return f"{self.rotation_deg:3.1f}° {self.gain:5.1%} {'turning' if self.turning else 'still':7}"


def rotations(axis: Array, angle: Array) -> Array:
    """Matrices (…, 3, 3) that turn by `angle` (…) about the unit vector `axis` (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.asarray(angle)[..., None, None]
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))


def _turned_by(vector_rad: Array) -> Array:
    size = float(np.linalg.norm(vector_rad))
    return rotations(vector_rad / size, np.array(size)) if size else np.eye(3)


class BuiltSource(ManyFrames):
    """A simulated pad with another world behind it. attitude: how the robot moves."""

    def __init__(self, config: PadConfig, defects: Defects, random: np.random.Generator) -> None:
        super().__init__(config, perfect=True)
        self._built = _drawn(config.pad(), self._built, defects, random)
        count = len(self._built.pad.sensors)
        self._offset_t = random.normal(0.0, OFFSET_T, (count, 3))
        self._strength = random.normal(0.0, UNEVEN, (3, 3))
        gradient = random.normal(0.0, GRADIENT_T / 11e-3, (3, 3))
        gradient = (gradient + gradient.T) / 2.0
        self._gradient_t_per_m = gradient - np.eye(3) * np.trace(gradient) / 3.0
        self.attitude: Literal["still", "tumbling", "turning"] = "still"

    def recorded(self, seconds: float) -> list[WireFrame]:
        """The next frames, from time zero of a new recording."""
        self._sequence = 0
        self._delivered[:] = np.iinfo(np.int64).min
        return [frame for batch in self.batches(round(seconds * RATE_HZ)) for frame in batch]

    def _attitudes(self, time_s: Array) -> Array:
        """Rotations (…, 3, 3) from axes of the room to axes of the pad."""
        if self.attitude == "tumbling":  # once about each axis
            turns = 3.0 * time_s / TURN_S
            x, y, z = (2.0 * np.pi * np.clip(turns - axis, 0.0, 1.0) for axis in range(3))
            return rotations(X, x) @ rotations(Y, y) @ rotations(Z, z)
        turning = np.deg2rad(TURNING_DEG_PER_S) if self.attitude == "turning" else 0.0
        return rotations(np.array([0.48, 0.6, 0.64]), turning * time_s)

    def _fields(self, sampled_s: Array) -> Array:
        attitude = self._attitudes(sampled_s)
        earth = np.einsum("...ij,j->...i", attitude, self._built.ambient_t)
        unit = earth / EARTH_T
        earth *= (1.0 + np.einsum("...i,ij,...j->...", unit, self._strength, unit))[..., None]
        here = (
            attitude
            @ self._gradient_t_per_m
            @ attitude.swapaxes(-1, -2)
            @ self._built.pad.sensors.position_m[..., None]
        )
        field_t = earth + here[..., 0]
        if self.mounted:
            touches = columns([self.finger(moment) for moment in sampled_s.ravel().tolist()])
            position_m, axis = (each.reshape(*sampled_s.shape, 3) for each in self._built.pose(*touches))
            field_t = field_t + cylinder_field(
                self._built.pad.sensors.position_m, position_m, axis, self._built.pad.magnet
            )
        return self._built.sensed(field_t) + self._offset_t


def _drawn(drawing: Pad, exact: MountedPad, defects: Defects, random: np.random.Generator) -> MountedPad:
    count = len(drawing.sensors)
    turned = [_turned_by(vector) for vector in np.deg2rad(random.normal(0.0, defects.rotation_deg, (count, 3)))]
    tilt = _turned_by(np.append(np.deg2rad(random.normal(0.0, 1.0, 2)), 0.0))
    place_m = drawing.sensors.position_m + random.normal(0.0, 1e-4, (count, 3))
    across = np.triu(random.normal(0.0, defects.cross_axis, (count, 3, 3)), 1)
    direction = random.standard_normal(3)
    askew = np.deg2rad(random.normal(0.0, 1.0, 2) * defects.magnet_tilt_deg) if defects.stated else np.zeros(2)
    from_z = tilt @ _turned_by(np.append(askew, 0.0)) @ exact.rest_axis_from_z
    pad = replace(
        drawing,
        sensors=SensorArray(place_m, drawing.sensors.axes @ np.array(turned)),
        magnet=drawing.magnet.with_remanence(
            drawing.magnet.remanence_t * float(np.exp(random.normal(0.0, defects.remanence)))
        ),
        rest_position_m=drawing.rest_position_m + random.normal(0.0, 1e-4, 3),
        rest_axis=from_z[:, 2],
    )
    gain = random.normal(1.0, defects.gain, (count, 3))
    ambient_t = EARTH_T * direction / np.linalg.norm(direction)
    mechanics: Any = StatedMechanics.drawn(exact.mechanics, random) if defects.stated else exact.mechanics
    return MountedPad(pad, gain, ambient_t, from_z, mechanics, across + across.transpose(0, 2, 1), tilted=tilt)


class Presses:
    """A Finger: presses of `hold_s` anywhere, 0.2 to 2 N, each after a pause as long."""

    def __init__(self, random: np.random.Generator, hold_s: float = 0.8) -> None:
        self._hold_s = hold_s
        self._each = np.column_stack([random.uniform(-1e-2, 1e-2, (64, 2)), random.uniform(0.2, 2.0, 64)])

    def __call__(self, time_s: float) -> Touch:
        cycle, within = divmod(time_s / self._hold_s, 2.0)
        x, y, force = self._each[int(cycle) % len(self._each)]
        rise = min(max(min((within - 1.0) / 0.25, (2.0 - within) / 0.25), 0.0), 1.0)
        return Touch(float(x), float(y), float(force) * rise) if rise else Touch(0.0, 0.0, 0.0)
