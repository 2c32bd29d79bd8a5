"""The unknowns of mounting and manufacture as one vector, and their effect on the field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp, square
from fmfts.arithmetic.matrix import cholesky, inverse, lengths, product
from fmfts.baseline import sensitivity
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.pad import Pad, Tolerance
from fmfts.pose import State, dipole_derivatives, octupole_m2
from fmfts.pose.state import turn_derivative

Array = NDArray[np.float64]

# The Earth's field has 0.25–0.65 G in an unknown direction; steel in a robot's arm adds to it.
AMBIENT_DEVIATION_T = 5e-5
# The change of the ambient field between two recordings while the robot stands still.
STANDING_AMBIENT_T = 1e-7
# A smaller variance of a sensitivity counts as zero, from a tolerance of zero.
EXACT = 1e-15


@dataclass(frozen=True, slots=True)
class Unknowns:
    """Rest pose and log moment (6), ambient field (3), sensor places (3N), sensitivities (9N), in prior deviations from
    the drawing and from the prior's `sensitivity` (9N,). deviation (9 + 12N,): the prior deviations in SI. precision
    (9 + 12N, 9 + 12N): of the prior in these units; after a turn of the robot the sensitivities are correlated."""

    pad: Pad
    deviation: Array
    sensitivity: Array
    precision: Array

    @classmethod
    def of(cls, pad: Pad, tolerance: Tolerance, ambient_free: bool, measured: Sensitivity | None = None) -> Unknowns:
        """ambient_free: the ambient field is unknown; else only its change since a bare recording is.

        measured: the sensitivities, None: only their tolerances are known. What has no tolerance counts as exact.
        """
        count = len(pad.sensors)
        known = measured or Sensitivity.untested(count, tolerance)
        free = np.flatnonzero(np.diagonal(known.covariance) > EXACT)
        sensitivity_deviation = np.zeros(9 * count)
        sensitivity_deviation[free] = np.sqrt(np.diagonal(known.covariance))[free]
        precision = np.eye(9 + 12 * count)
        if len(free):
            scale, places = sensitivity_deviation[free], 9 + 3 * count + free
            precision[np.ix_(places, places)] = inverse(known.covariance[np.ix_(free, free)] / scale / scale[:, None])
        spread = np.concatenate(
            [
                np.full(3, tolerance.magnet_position_m),
                np.full(2, tolerance.tilt_rad),
                [tolerance.remanence],
                np.full(3, AMBIENT_DEVIATION_T if ambient_free else STANDING_AMBIENT_T),
                np.full(3 * count, tolerance.sensor_position_m),
                sensitivity_deviation,
            ]
        )
        return cls(pad, spread, known.mean, precision)

    def unpack(self, scaled: Array) -> tuple[State, Array, Array]:
        """State, sensor places (N, 3) and sensitivity matrices (N, 3, 3)."""
        count = len(self.pad.sensors)
        values = self.deviation * scaled
        places = self.pad.sensors.position_m + values[9 : 9 + 3 * count].reshape(count, 3)
        matrix = sensitivity.matrices(self.sensitivity + values[9 + 3 * count :])
        return State.at_rest(self.pad).stepped(values[:9]), places, matrix

    def start_at(self, place_m: Array) -> Array:
        """The vector (M,) of sensors at `place_m` (N, 3) that are turned as drawn; all else is as expected."""
        offset = np.zeros(len(self.deviation))
        first, count = 9, place_m.size
        offset[first : first + count] = (place_m - self.pad.sensors.position_m).ravel()
        offset[first + 2 * count : first + 3 * count] = -self.sensitivity[count : 2 * count]
        exact = self.deviation == 0.0
        scaled: Array = np.where(exact, 0.0, offset / np.where(exact, 1.0, self.deviation))
        return scaled

    @property
    def cylinder_m2(self) -> float:
        """κ of the real magnet, even if the tracker uses a dipole."""
        return octupole_m2(self.pad.magnet)

    @property
    def model_deviation_t(self) -> float:
        """The part of the cylinder's field that `predict` leaves out, at the nearest sensor."""
        away = lengths(self.pad.sensors.position_m - self.pad.rest_position_m)
        return self.pad.magnet.beyond_octupole_t(float(away.min()))

    def predicted(self, scaled: Array) -> tuple[Array, Array]:
        """As `predict`, of the cylinder itself."""
        return self.predict(*self.unpack(scaled), octupole_m2=self.cylinder_m2)

    def curvature_t(self, scaled: Array, covariance: Array) -> Array:
        """(3N,) rms of the second-order part of each field value around `scaled`, over errors with `covariance` (M, M).

        With H the second derivatives by independent errors of deviation one, the mean is ½ tr H, the variance ½ tr H².
        """
        root = cholesky(covariance)
        here, errors = self.predicted(scaled)[1], self.deviation[:, None] * root
        bent = np.array([product(self.predicted(scaled + error)[1] - here, errors) for error in root.T])
        mean, variance = np.trace(bent, axis1=0, axis2=2) / 2.0, square(bent).sum(axis=(0, 2)) / 2.0
        return np.asarray(np.sqrt(square(mean) + variance), dtype=np.float64)

    def predict(
        self,
        state: State,
        places: Array,
        matrix: Array,
        start_axis: Array | None = None,
        octupole_m2: float | None = None,
    ) -> tuple[Array, Array]:
        """Field (N, 3) as the chips report it, and its Jacobian (3N, 9 + 12N) in SI.

        matrix (N, 3, 3): sensitivities. octupole_m2: κ of the magnet, None: the tracker's. The tilt is a step in the
        tangent plane of `start_axis`, None: of the drawing's axis, from which the search for the rest pose starts.
        """
        start_axis = self.pad.rest_axis if start_axis is None else start_axis
        count = len(places)
        strength = self.pad.magnet.strength_t_m3 * exp(state.log_moment)
        octupole_m2 = self.pad.magnet.modelled_octupole_m2 if octupole_m2 is None else octupole_m2
        dipole, by_position, by_axis = dipole_derivatives(places, state.position_m, state.axis, strength, octupole_m2)
        to_sensor = self.pad.sensors.axes.transpose(0, 2, 1)
        field = (product(to_sensor, (dipole + state.ambient_t)[:, :, None]))[:, :, 0]
        columns = np.zeros((count, 3, len(self.deviation)))
        columns[:, :, 0:3] = moved = product(to_sensor, by_position)
        columns[:, :, 3:5] = product(to_sensor, by_axis, turn_derivative(start_axis, state.axis))
        columns[:, :, 5] = (product(to_sensor, dipole[:, :, None]))[:, :, 0]
        columns[:, :, 6:9] = to_sensor
        for sensor in range(count):
            columns[sensor, :, 9 + 3 * sensor : 12 + 3 * sensor] = -moved[sensor]
        columns = product(matrix, columns)
        columns[:, :, 9 + 3 * count :] = sensitivity.columns(field)
        return product(matrix, field[:, :, None])[:, :, 0], columns.reshape(3 * count, -1)
