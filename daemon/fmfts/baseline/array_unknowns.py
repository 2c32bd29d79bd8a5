"""The unknowns of mounting and manufacture for a pad with several magnets, and the field that follows from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import inverse, product
from fmfts.baseline import sensitivity
from fmfts.baseline.sensitivity import Sensitivity
from fmfts.baseline.unknowns import AMBIENT_DEVIATION_T, STANDING_AMBIENT_T
from fmfts.pad import Pad, SensorArray, Tolerance
from fmfts.pose.magnets import CHANGE, Magnets, field_and_slope, rest_frames, sum_of_fields

Array = NDArray[np.float64]

OF_MAGNET = 6  # unknowns of each: position, tilt, log moment


@dataclass(frozen=True, slots=True)
class ArrayUnknowns:
    """For each magnet its place, tilt and log moment (6M), ambient field (3), sensor places (3N), sensitivities (9N),
    in prior deviations from the drawing and from `sensitivity` (9N,). deviation (U,): these, in SI. precision (U, U).
    """

    pad: Pad
    drawn: Magnets
    frames: Array
    deviation: Array
    sensitivity: Array
    precision: Array

    @classmethod
    def of(cls, pad: Pad, tolerance: Tolerance, ambient_free: bool, measured: Sensitivity) -> ArrayUnknowns:
        drawn, count = Magnets.drawn(pad), len(pad.sensors)
        each = np.array(
            [tolerance.magnet_position_m] * 3 + [tolerance.tilt_rad] * 2 + [tolerance.remanence], dtype=float
        )
        spread = np.sqrt(np.diagonal(measured.covariance))
        deviation = np.concatenate(
            [
                np.tile(each, len(drawn)),
                np.full(3, AMBIENT_DEVIATION_T if ambient_free else STANDING_AMBIENT_T),
                np.full(3 * count, tolerance.sensor_position_m),
                spread,
            ]
        )
        precision = np.eye(len(deviation))
        free = np.flatnonzero(spread > 0.0)
        places = len(deviation) - 9 * count + free
        scaled = measured.covariance[np.ix_(free, free)] / spread[free] / spread[free, None]
        precision[np.ix_(places, places)] = inverse(scaled)
        return cls(pad, drawn, rest_frames(drawn.axis), deviation, measured.mean, precision)

    @property
    def of_magnets(self) -> int:
        return OF_MAGNET * len(self.drawn)

    def unpack(self, scaled: Array) -> tuple[Magnets, Array, Array, Array]:
        """Magnets, ambient field (3,), sensor places (N, 3) and sensitivity matrices (N, 3, 3)."""
        count, first = len(self.pad.sensors), self.of_magnets
        values = self.deviation * scaled
        own = values[:first].reshape(-1, OF_MAGNET)
        magnets = self.drawn.stronger(own[:, 5]).changed(own[:, :CHANGE].ravel(), self.frames)
        places = self.pad.sensors.position_m + values[first + 3 : first + 3 + 3 * count].reshape(count, 3)
        matrix = sensitivity.matrices(self.sensitivity + values[first + 3 + 3 * count :])
        return magnets, values[first : first + 3], places, matrix

    def predicted(self, scaled: Array) -> tuple[Array, Array]:
        return self.predict(*self.unpack(scaled))

    def predict(self, magnets: Magnets, ambient_t: Array, places: Array, matrix: Array) -> tuple[Array, Array]:
        """Field (N, 3) as the chips report it, and its derivative (3N, U) in SI."""
        count, first = len(places), self.of_magnets
        drawn_axes = SensorArray(places, self.pad.sensors.axes)
        to_sensor = self.pad.sensors.axes.transpose(0, 2, 1)
        own, slope = field_and_slope(magnets, self.frames, drawn_axes)
        field = own + product(to_sensor, ambient_t)
        columns = np.zeros((count, 3, len(self.deviation)))
        by_pose = slope.reshape(count, 3, -1, CHANGE)
        for number in range(len(magnets)):
            at = OF_MAGNET * number
            columns[:, :, at : at + CHANGE] = by_pose[:, :, number]
            alone = Magnets(*(value[number : number + 1] for value in _values(magnets)))
            columns[:, :, at + 5] = drawn_axes.to_sensor(sum_of_fields(alone, places))
        columns[:, :, first : first + 3] = to_sensor
        # Moving a sensor is moving all magnets the other way.
        towards = by_pose[:, :, :, :3].sum(axis=2)
        for sensor, toward in enumerate(towards):
            at = first + 3 + 3 * sensor
            columns[sensor, :, at : at + 3] = -toward
        columns = product(matrix, columns)
        columns[:, :, first + 3 + 3 * count :] = sensitivity.columns(field)
        return product(matrix, field[:, :, None])[:, :, 0], columns.reshape(3 * count, -1)


def _values(magnets: Magnets) -> tuple[Array, Array, Array, Array]:
    return magnets.position_m, magnets.axis, magnets.strength_t_m3, magnets.octupole_m2
