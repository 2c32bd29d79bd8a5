"""Simulates a built pad, which differs from its drawing by building errors; a baseline has to estimate them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fmfts.pad import Array, Magnet, Pad, Tolerance, rotation_from_vector
from fmfts_simulation.cylinder import cylinder_field
from fmfts_simulation.mechanics import Mechanics
from fmfts_simulation.solved_table import standard_mechanics

SENSOR_PLACE_M = 0.1e-3  # one standard deviation of each error, as in the config's [pad.tolerance]
MAGNET_PLACE_M = 0.1e-3
MAGNET_TILT_RAD = np.deg2rad(1.0)  # with the whole pad
REMANENCE = 0.01
GAIN = 0.005
SENSOR_ROTATION_RAD = float(np.deg2rad(1.5))  # about each axis: breakout boards that a hand placed
CROSS_AXIS = 0.005
EARTH_T = 0.5e-4
# A good pad, whose tilt at rest is that of the silicone. Users' tolerances are wider, because they include worse pads.
GOOD = Tolerance(
    sensor_position_m=SENSOR_PLACE_M,
    magnet_position_m=MAGNET_PLACE_M,
    magnet_tilt_rad=0.0,
    gain=GAIN,
    remanence=REMANENCE,
    sensor_rotation_rad=SENSOR_ROTATION_RAD,
    cross_axis=CROSS_AXIS,
    pad_tilt_rad=MAGNET_TILT_RAD,
)


def with_chips_turned(sensor_rotation_rad: float, cross_axis: float) -> Tolerance:
    """The tolerance of a good pad, with these deviations of its chips."""
    return replace(GOOD, sensor_rotation_rad=sensor_rotation_rad, cross_axis=cross_axis)


@dataclass(frozen=True, slots=True)
class MountedPad:
    """A built pad. rest_axis_from_z (3, 3): from axes in which the unloaded magnet points along +z to pad axes.

    Each chip has its own axes: `pad.sensors` holds them as they are turned, cross_axis (N, 3, 3) their cross-axis
    terms. tilted (3, 3): from axes of the silicone to those of the sensors; presses move the magnet in the former.
    magnet_off_m (2,): how far the magnet is cast from the pad's middle. On a wide pad a press moves any magnet as it
    would move one in the middle at the same distance.
    """

    pad: Pad
    gain: Array
    ambient_t: Array
    rest_axis_from_z: Array
    mechanics: Mechanics = field(default_factory=standard_mechanics)
    cross_axis: Array | None = None
    magnet_off_m: Array = field(default_factory=lambda: np.zeros(2))
    tilted: Array = field(default_factory=lambda: np.eye(3))

    @classmethod
    def built(
        cls,
        drawing: Pad,
        random: np.random.Generator,
        mechanics: Mechanics | None = None,
        errors: Tolerance = GOOD,
    ) -> MountedPad:
        """A pad with random building errors, in the Earth's field of random direction."""
        tilt = np.append(random.normal(0.0, errors.pad_tilt_rad, 2), 0.0)
        upright = _rotation_from_z(drawing.rest_axis)
        turn = upright @ rotation_from_vector(tilt)
        sensors = drawing.sensors
        pad = Pad(
            name=drawing.name,
            sensors=type(sensors)(
                sensors.position_m + random.normal(0.0, errors.sensor_position_m, sensors.position_m.shape),
                sensors.axes,
            ),
            magnet=drawing.magnet.with_remanence(drawing.magnet.remanence_t * random.normal(1.0, errors.remanence)),
            rest_position_m=drawing.rest_position_m + random.normal(0.0, errors.magnet_position_m, 3),
            rest_axis=turn[:, 2],
            chip=drawing.chip,
        )
        ambient = random.standard_normal(3)
        ambient_t = EARTH_T * ambient / np.linalg.norm(ambient)
        gain = random.normal(1.0, errors.gain, sensors.position_m.shape)
        turns = [rotation_from_vector(vector) for vector in random.normal(0.0, errors.sensor_rotation_rad, gain.shape)]
        turned = type(sensors)(pad.sensors.position_m, sensors.axes @ np.array(turns))
        upper = np.triu(random.normal(0.0, errors.cross_axis, (*gain.shape, 3)), 1)
        whole = replace(pad, sensors=turned)
        built = cls(
            whole,
            gain,
            ambient_t,
            turn,
            mechanics or standard_mechanics(),
            upper + upper.transpose(0, 2, 1),
            tilted=turn @ upright.T,
        )
        if not errors.magnet_tilt_rad:
            return built
        return built.with_magnet_tilted(np.append(random.normal(0.0, errors.magnet_tilt_rad, 2), 0.0))

    @classmethod
    def exact(cls, drawing: Pad, mechanics: Mechanics | None = None) -> MountedPad:
        """A pad without building errors and without an ambient field."""
        gain, turn = np.ones((len(drawing.sensors), 3)), _rotation_from_z(drawing.rest_axis)
        return cls(drawing, gain, np.zeros(3), turn, mechanics or standard_mechanics())

    def with_magnet_tilted(self, about_rad: Array) -> MountedPad:
        """The same with the magnet turned in its silicone, by a rotation vector (3,)."""
        turn = rotation_from_vector(about_rad) @ self.rest_axis_from_z
        return replace(self, pad=replace(self.pad, rest_axis=turn[:, 2]), rest_axis_from_z=turn)

    def pose(self, *press: Array) -> tuple[Array, Array]:
        """Position in m (K, 3) and unit axis (K, 3) of the magnet. press: x, y in m, force, shear x, y, each (K,)."""
        return self.moved(self.response(*press))

    def centred(self, x_m: Array, y_m: Array, *load: Array) -> tuple[Array, ...]:
        """A press relative to the magnet's place, as in the table of presses."""
        return x_m - self.magnet_off_m[0], y_m - self.magnet_off_m[1], *load

    def response(self, *press: Array) -> Array:
        """(K, 5) movement of the magnet: displacement in m, and x and y of its axis where its rest axis is +z."""
        return self.mechanics.response(*self.centred(*press))

    def moved(self, response: Array) -> tuple[Array, Array]:
        """Position in m (K, 3) and unit axis (K, 3) of the magnet after a movement (K, 5)."""
        tilt = response[:, 3:]
        upright = np.sqrt(1.0 - np.sum(tilt * tilt, axis=1, keepdims=True))
        axis = np.concatenate([tilt, upright], axis=1)
        return self.pad.rest_position_m + response[:, :3] @ self.tilted.T, axis @ self.rest_axis_from_z.T

    def magnet_field(self, *press: Array, magnet: Magnet | None = None) -> Array:
        """The magnet's field (N, 3) in tesla at the sensors, in pad axes: at sensor i under the i-th of N presses."""
        position_m, axis = self.pose(*press)
        return cylinder_field(self.pad.sensors.position_m, position_m, axis, magnet or self.pad.magnet)

    def sensed(self, field_t: Array) -> Array:
        """A field (…, N, 3) in pad axes → the chips' readings."""
        own = self.pad.sensors.to_sensor(field_t)
        if self.cross_axis is not None:
            own = own + np.einsum("iab,...ib->...ia", self.cross_axis, own)
        return np.asarray(self.gain * own, dtype=np.float64)


def _rotation_from_z(axis: Array) -> Array:
    """The shortest rotation from +z to unit `axis`."""
    across = np.array([-axis[1], axis[0], 0.0])
    sine = float(np.linalg.norm(across))
    if sine == 0.0:
        return np.diag([1.0, np.sign(axis[2]), np.sign(axis[2])])
    return rotation_from_vector(across / sine * np.arctan2(sine, axis[2]))
