"""The baseline's uncertainty of a pad with several magnets, as in each message."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product
from fmfts.baseline.array_mounting import ArrayMounting
from fmfts.bus.messages import Vector
from fmfts.pad import Pad
from fmfts.pose.magnets import CHANGE, Magnets

Array = NDArray[np.float64]

REST = 6  # numbers of a magnet at rest: position, tilt and log moment


class Where(NamedTuple):
    """A magnet, with the deviations of its place, which include the baseline's uncertainty of its rest."""

    position_m: Vector
    position_sd_m: Vector
    axis: Vector
    axis_sd_rad: float


class AtRest:
    """variance (M, 6): of position, tilt and log moment. remanences: of each magnet, and its deviation, in T."""

    def __init__(self, pad: Pad, mounting: ArrayMounting) -> None:
        self.variance = np.maximum(np.diagonal(mounting.rest_covariance), 0.0).reshape(-1, REST)
        remanences_t = np.array(mounting.remanences_t(pad))
        self.remanences = np.stack([remanences_t, remanences_t * np.sqrt(self.variance[:, -1])], axis=1).tolist()
        self._last: tuple[Magnets, Array, list[Where]] | None = None
        # The mean over the sensors: of their noise, and of the remaining errors of gains and rotations.
        count = len(pad.sensors)
        by_ambient = mounting.sensors.axes.transpose(0, 2, 1).reshape(3 * count, 3)
        own = mounting.errors.by_field.reshape(len(by_ambient), -1)
        mean_error = product(by_ambient.T, own).reshape(3, 3, -1) / count
        self._ambient_error = mean_error.swapaxes(1, 2)
        noise = square(mounting.noise_t / mounting.gain).ravel()
        self._ambient_noise_t2 = product(square(by_ambient).T, noise) / square(float(count))

    def described(self, magnets: Magnets, variance: Array) -> list[Where]:
        """Each magnet. variance (M, 5): of its change since rest. Those of an untouched pad are the same in each frame,
        and are remembered."""
        if self._last is None or self._last[0] is not magnets or self._last[1] is not variance:
            whole = np.sqrt(variance + self.variance[:, :CHANGE]).tolist()
            each = zip(magnets.position_m.tolist(), magnets.axis.tolist(), whole, strict=True)
            found = [
                Where((x, y, z), (x_sd, y_sd, z_sd), (along_x, along_y, along_z), max(tilt, other))
                for (x, y, z), (along_x, along_y, along_z), (x_sd, y_sd, z_sd, tilt, other) in each
            ]
            self._last = magnets, variance, found
        return self._last[2]

    def ambient_deviation_t(self, ambient_t: Array) -> Array:
        """(3,) of a change of the ambient field since the baseline, on an untouched pad."""
        errors = product(self._ambient_error, ambient_t)
        deviation: Array = np.sqrt(self._ambient_noise_t2 + (errors * errors).sum(axis=1))
        return deviation
