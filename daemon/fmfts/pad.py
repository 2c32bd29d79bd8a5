"""Describes a pad in SI units: the places of its sensors, its magnet, and where the magnet rests."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import power
from fmfts.arithmetic.matrix import length, product, root_of_squares
from fmfts.arithmetic.series import cos, sin
from fmfts.sensor.chips import DEFAULT_CHIP, NOISE_T, Chip

Array = NDArray[np.float64]
Dimensions = dict[str, tuple[float, ...]]


def rotation_from_vector(vector_rad: Array) -> Array:
    """Rotation matrix (3, 3) from a rotation vector (3,) in radians (Rodrigues' formula)."""
    angle = length(vector_rad)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector_rad / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Array = np.eye(3) + sin(angle) * cross + (1.0 - cos(angle)) * product(cross, cross)
    return rotation


@dataclass(frozen=True, slots=True)
class SensorArray:
    """Places `position_m` (N, 3) of N sensors, and their `axes` (N, 3, 3): the columns are unit vectors in pad axes.

    The axes of a drawing are at right angles; those of a chip as built not quite.
    """

    position_m: Array
    axes: Array

    @classmethod
    def aligned(cls, position_m: Array) -> SensorArray:
        """Sensors whose axes are parallel to the pad's."""
        position_m = np.asarray(position_m, dtype=float)
        return cls(position_m, np.broadcast_to(np.eye(3), (len(position_m), 3, 3)).copy())

    def mirrored(self) -> SensorArray:
        """The same sensors with their z inverted."""
        return type(self)(self.position_m, self.axes * np.array([1.0, 1.0, -1.0]))

    def __len__(self) -> int:
        return len(self.position_m)

    def to_pad(self, field: Array) -> Array:
        """Vectors (…, N, 3) in each sensor's own axes → the same vectors in pad axes. Only for axes at right angles."""
        in_pad_axes: Array = product(self.axes, field[..., None])[..., 0]
        return in_pad_axes

    def to_sensor(self, field: Array) -> Array:
        """Vectors (…, N, 3) in pad axes → their components along each sensor's own axes."""
        in_sensor_axes: Array = product(self.axes.transpose(0, 2, 1), field[..., None])[..., 0]
        return in_sensor_axes


# A cylinder's octupole is modelled where its field at a sensor exceeds the noise of a sample. That adds no unknown and
# takes no time (`python -m fmfts_lab.bench speed`). On the standard pad it is 0.5 µT; without it the pose would be
# wrong by a tenth of its Cramér–Rao bound (lab/README.md).
NEGLECTED_OCTUPOLE_T = NOISE_T


@dataclass(frozen=True, slots=True)
class Magnet:
    """An axially magnetised cylinder. as_cylinder: the sensors are so near that its octupole must be modelled."""

    diameter_m: float
    length_m: float
    remanence_t: float
    as_cylinder: bool = False

    @property
    def strength_t_m3(self) -> float:
        """B_T = Br·r²·L/4 of the paper's Eq. 2, in T·m³: the dipole's field is B_T·(3(m̂·r)r/r⁵ − m̂/r³)."""
        radius_m = self.diameter_m / 2.0
        return self.remanence_t * (radius_m * radius_m) * self.length_m / 4.0

    @property
    def octupole_m2(self) -> float:
        """κ: the octupole moment of the cylinder divided by its dipole moment."""
        radius_m = self.diameter_m / 2.0
        return self.length_m * self.length_m / 4.0 - 3.0 * (radius_m * radius_m) / 4.0

    @property
    def modelled_octupole_m2(self) -> float:
        """κ where `as_cylinder`, else 0, that of a dipole."""
        return self.octupole_m2 if self.as_cylinder else 0.0

    def beyond_octupole_t(self, distance_m: float) -> float:
        """Largest field, in T, of the multipole after the octupole: on the axis, 6 B_T λ/r⁷.

        λ = L⁴/16 − 5L²R²/8 + 5R⁴/8: fifth moment of the disks of charge at the end faces, divided by the first.
        """
        length_2, radius_2 = self.length_m * self.length_m, self.diameter_m * self.diameter_m / 4.0
        moment_m4 = length_2 * length_2 / 16.0 - 5.0 * length_2 * radius_2 / 8.0 + 5.0 * radius_2 * radius_2 / 8.0
        return 6.0 * self.strength_t_m3 * abs(moment_m4) / float(power(distance_m, 7))

    def seen_from(self, distance_m: float) -> Magnet:
        """This magnet; as_cylinder if a sensor at `distance_m` feels its octupole (4 B_T κ/r⁵ on the axis)."""
        octupole_t = 4.0 * self.strength_t_m3 * abs(self.octupole_m2) / power(distance_m, 5)
        return replace(self, as_cylinder=octupole_t > NEGLECTED_OCTUPOLE_T)

    def with_remanence(self, remanence_t: float) -> Magnet:
        return replace(self, remanence_t=remanence_t)


@dataclass(frozen=True, slots=True)
class Silicone:
    """How a pad's silicone differs from a spring, as shares of the magnet's way.

    creep_per_decade: for each tenfold of time under a load. hysteresis: half the difference between loading and
    unloading, besides creep.
    """

    creep_per_decade: float = 0.0
    hysteresis: float = 0.0


@dataclass(frozen=True, slots=True)
class RestingMagnet:
    """A magnet, and where it rests in the unloaded pad."""

    magnet: Magnet
    rest_position_m: Array
    rest_axis: Array


@dataclass(frozen=True, slots=True)
class Pad:
    """One pad with the nominal places of its drawing. The baseline estimates the places of the mounted pad.

    other_magnets: those besides the first, of a pad that holds several. are_magnets_known: if not, the magnets here are
    meaningless, and the contact model goes from contact to field.
    """

    name: str
    sensors: SensorArray
    magnet: Magnet
    rest_position_m: Array
    rest_axis: Array
    chip: Chip = DEFAULT_CHIP  # the index of each sensor
    silicone: Silicone = Silicone()
    other_magnets: tuple[RestingMagnet, ...] = ()
    are_magnets_known: bool = True

    @property
    def magnets(self) -> tuple[RestingMagnet, ...]:
        """All of them, in the order of the configuration."""
        return (RestingMagnet(self.magnet, self.rest_position_m, self.rest_axis), *self.other_magnets)

    @property
    def dimensions(self) -> Dimensions:
        """The numbers that `geometry_hash` is of, by their keys in the configuration, in its units."""
        numbers: dict[str, Array | list[float]] = {
            "geometry.sensors_mm": self.sensors.position_m.ravel() * 1e3,
            "geometry.sensor_rotations (as matrices)": self.sensors.axes.ravel(),
            "magnet.diameter_mm": [self.magnet.diameter_m * 1e3],
            "magnet.length_mm": [self.magnet.length_m * 1e3],
            "magnet.rest_mm": self.rest_position_m * 1e3,
            "magnet.rest_axis": self.rest_axis,
        }
        for number, other in enumerate(self.other_magnets, 1):
            numbers |= {
                f"magnet[{number}].diameter_mm": [other.magnet.diameter_m * 1e3],
                f"magnet[{number}].length_mm": [other.magnet.length_m * 1e3],
                f"magnet[{number}].rest_mm": other.rest_position_m * 1e3,
                f"magnet[{number}].rest_axis": other.rest_axis,
            }
        return {name: tuple(round(float(value), 6) + 0.0 for value in values) for name, values in numbers.items()}

    @property
    def geometry_hash(self) -> str:
        """Twelve hex digits of all nominal dimensions, by which baselines and models know the pad that they are for.

        The remanence is left out: pads of one structure share a calibration, however strong their magnets are.
        """
        numbers = np.concatenate(
            [
                self.sensors.position_m.ravel(),
                self.sensors.axes.ravel(),
                [self.magnet.diameter_m, self.magnet.length_m],
                self.rest_position_m,
                self.rest_axis,
                *(
                    np.concatenate([[one.magnet.diameter_m, one.magnet.length_m], one.rest_position_m, one.rest_axis])
                    for one in self.other_magnets
                ),
            ]
        )
        canonical = ",".join(f"{value + 0.0:.9f}" for value in np.round(numbers, 9) + 0.0)
        return hashlib.sha256(canonical.encode()).hexdigest()[:12]


def differences(one: Dimensions, other: Dimensions, whose: str, others: str) -> str:
    """The dimensions that differ, as text, each with both values. whose, others: names of both."""
    return "; ".join(
        f"{name} is {_listed(one[name])} {whose} and {_listed(other[name])} {others}"
        for name in one
        if name in other and one[name] != other[name]
    )


def _listed(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:g}" for value in values)


@dataclass(frozen=True, slots=True)
class Placement:
    """A pad's place in another frame: `position_m` (3,) of its origin, `rotation` (3, 3) from pad axes to the frame's.

    tolerance_m: standard deviation of the position, along each axis.
    """

    position_m: Array
    rotation: Array
    tolerance_m: float

    def seen_from(self, other: Placement) -> Placement:
        """This placement in the axes of another pad; both are given in one frame."""
        offset_m = product(other.rotation.T, self.position_m - other.position_m)
        tolerance_m = float(root_of_squares(self.tolerance_m, other.tolerance_m))
        return type(self)(offset_m, product(other.rotation.T, self.rotation), tolerance_m)

    def point(self, place_m: Array) -> Array:
        """A point (3,) in pad axes → the same point in the frame."""
        point: Array = self.position_m + product(self.rotation, place_m)
        return point


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Standard deviations between a pad and its drawing; gain and remanence are relative.

    cross_axis: of an axis's reading of a perpendicular field, relative to that field, besides the chip's rotation.
    """

    sensor_position_m: float
    magnet_position_m: float
    magnet_tilt_rad: float  # tilt of the magnet in its silicone
    gain: float
    remanence: float
    sensor_rotation_rad: float = 0.0  # about each axis
    cross_axis: float = 0.0
    pad_tilt_rad: float = 0.0  # tilt of the silicone against the sensors

    @property
    def tilt_rad(self) -> float:
        """The tilt of the magnet against the sensors."""
        return float(root_of_squares(self.magnet_tilt_rad, self.pad_tilt_rad))

    def tilts_given(self, found_rad: Array, told: Array) -> SharedTilt:
        """Shares of magnet and pad in a tilt (2,) that was found at rest.

        A magnet's own tilt is bounded by its mould; a pad is glued by hand. So a tilt that both deviations together do
        not explain widens the pad's deviation to its most likely value.

        told (2,): the share of a tilt's variance that the recording determines. The rest is noise in what was found, of
        the variance 1/told − 1 times the tilt's: it is no tilt of the pad.
        """
        noise = self.tilt_rad * self.tilt_rad * float(np.mean(1.0 / told - 1.0))
        square = float(product(found_rad, found_rad)) / 2.0 - noise
        of_magnet = self.magnet_tilt_rad * self.magnet_tilt_rad
        of_pad = max(self.pad_tilt_rad * self.pad_tilt_rad, square - of_magnet if self.pad_tilt_rad else 0.0)
        share = of_pad / (of_pad + of_magnet) if of_pad else 0.0
        return SharedTilt(share, self.magnet_tilt_rad * float(np.sqrt(share)))


class SharedTilt(NamedTuple):
    """pad_share: the most likely share of the whole pad in a tilt that is found at rest. unshared_rad: the deviation of
    the pad's own tilt if the sum of both tilts is known.
    """

    pad_share: float
    unshared_rad: float


@dataclass(frozen=True, slots=True)
class DriftLimits:
    """Limits of the automatic baseline, which follows a slow drift of the rest pose.

    quiet_s: time without contact before it follows. rate_m_per_s, limit_m: of the rest pose; a tilt counts as the
    displacement that it causes at 4 mm. force_below_n: upper limit of that time's mean force plus three deviations.
    """

    quiet_s: float
    rate_m_per_s: float
    limit_m: float
    force_below_n: float
