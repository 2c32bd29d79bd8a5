"""Expected errors of healthy sensors: their noise, and what the baseline leaves unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FieldErrors:
    """Lasting errors of the magnet's field, from one deviation of each of K independent causes; to first order.

    by_pose (5, 3N, K): error (T) per change of the pose from rest (m, rad). by_field (3N, 3, K): error per change of
    the ambient field along the pad's axes.
    """

    by_pose: Array
    by_field: Array

    @property
    def table(self) -> Array:
        """(K, 8, 3N): what the C code takes."""
        return np.concatenate([self.by_pose.transpose(2, 0, 1), self.by_field.transpose(2, 1, 0)], axis=1)

    def at(self, change: Array, ambient_t: Array) -> Array:
        """Errors (3N, K) T in sensor axes, after a change of pose (5,) and of ambient field (3,) since the baseline."""
        by_pose = product(change, self.by_pose.reshape(len(change), -1)).reshape(self.by_pose.shape[1:])
        errors: Array = by_pose + product(ambient_t, self.by_field)
        return errors


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Errors of healthy sensors. noise_t (N, 3): white noise of one sample. lasting: None if there are no others."""

    noise_t: Array
    lasting: FieldErrors | None = None
