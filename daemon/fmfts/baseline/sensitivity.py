"""What is known about each chip's sensitivity matrix K (reported = K·true): from tolerances, or from a turn.

K = diag(g) − [θ]× + S. g: the gains of the three axes. θ: the rotation vector of the chip against its place in the
drawing. S: symmetric, without a diagonal; it holds the cross-axis sensitivities. The rotation is of first order: at
three degrees the second order is a thousandth, and the tolerances of gain and cross-axis sensitivity contain it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import lengths, product
from fmfts.pad import Tolerance

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Most probable values (9N,) and covariance (9N, 9N): gains (3N), rotations (3N) rad, cross-axis terms (3N).

    The cross-axis term of x couples y with z, and so on.
    """

    mean: Array
    covariance: Array

    @classmethod
    def tested(cls, gain: Array, deviation: float, tolerance: Tolerance) -> Sensitivity:
        """For chips whose gains (N, 3) a self-test measured, each with this deviation."""
        known, mean = cls.untested(len(gain), tolerance), ideal(len(gain))
        variance = np.diagonal(known.covariance).copy()
        mean[: gain.size], variance[: gain.size] = gain.ravel(), square(deviation)
        return cls(mean, np.diag(variance))

    @classmethod
    def untested(cls, count: int, tolerance: Tolerance) -> Sensitivity:
        """For chips with only tolerances known."""
        return cls(ideal(count), np.diag(square(deviations(count, tolerance))))


def ideal(count: int) -> Array:
    """The sensitivities (9N,) of chips without errors."""
    return np.concatenate([np.ones(3 * count), np.zeros(6 * count)])


def deviations(count: int, tolerance: Tolerance) -> Array:
    """(9N,) standard deviations."""
    each = [tolerance.gain, tolerance.sensor_rotation_rad, tolerance.cross_axis]
    return np.repeat(each, 3 * count)


def matrices(values: Array) -> Array:
    """K (N, 3, 3, …) of values (9N, …). It is linear: the errors of the values give the errors of K."""
    gain, rotation, cross = values.reshape(3, -1, 3, *values.shape[1:])
    found = np.zeros((len(gain), 3, 3, *values.shape[1:]))
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        found[:, axis, axis] = gain[:, axis]
        found[:, after, last] = cross[:, axis] + rotation[:, axis]
        found[:, last, after] = cross[:, axis] - rotation[:, axis]
    return found


# (3, 3, 9) derivatives of a sensor's K by its values.
BY_VALUE = matrices(np.eye(9))[0]


def columns(field: Array) -> Array:
    """(N, 3, 9N) derivatives of the reported field K·field by the 9N values. field (N, 3): in sensor axes."""
    each, count = np.arange(len(field)), len(field)
    found = np.zeros((count, 3, 3, count, 3))
    found[each, :, :, each] = (BY_VALUE * field[:, None, :, None]).sum(axis=2).reshape(count, 3, 3, 3)
    return found.reshape(count, 3, 9 * count)


def split(matrix: Array, drawn_axes: Array) -> tuple[Array, Array]:
    """K (N, 3, 3) as gains (N, 3) along axes (N, 3, 3), whose columns are unit vectors in pad axes.

    drawn_axes: those of the drawing. A chip's axes are its directions of measurement; they need not be at right angles.
    """
    gain = lengths(matrix)
    return gain, product(drawn_axes, (matrix / gain[:, :, None]).transpose(0, 2, 1))


def relative_covariance(covariance: Array) -> Array:
    """(9N, 9N) covariance of the values without the gain and the rotation that all sensors have in common.

    Moment and pose of the magnet absorb those, and the ambient field.
    """
    count = len(covariance) // 9
    gains = 3 * count
    common = np.zeros((9 * count, 9 * count))
    common[:gains, :gains] = 1.0 / gains
    for axis in range(3):
        of_all = slice(gains + axis, 2 * gains, 3)
        common[of_all, of_all] = 1.0 / count
    apart = np.eye(9 * count) - common
    left: Array = product(apart, covariance, apart)
    return left


def relative_deviation(covariance: Array) -> Array:
    """(N, 3, 3) deviation of the elements of K, without what all sensors have in common."""
    count = len(covariance) // 9
    by_value = matrices(np.eye(9 * count)).reshape(9 * count, 9 * count)
    variance = np.diagonal(product(by_value, relative_covariance(covariance), by_value.T))
    deviation: Array = np.sqrt(np.maximum(variance, 0.0)).reshape(count, 3, 3)
    return deviation
