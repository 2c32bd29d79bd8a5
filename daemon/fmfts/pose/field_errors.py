"""What the residuals of sensors that are well look like: their noise, and what the baseline left open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product
from fmfts.pose.state import State, tangent_basis

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FieldErrors:
    """Errors of the magnet's field that last, by one deviation each of K independent causes; to first order.

    by_pose (5, 3N, K): for a unit change of the pose from rest, m and rad. by_field (3N, K): for a unit field along
    each sensor's axes, relative. rotation (N, 3, 3): pad axes from sensor axes.
    """

    by_pose: Array
    by_field: Array
    rotation: Array

    def at(self, change: Array, ambient_t: Array) -> Array:
        """(3N, K) in tesla, sensor axes: of a change of pose (5,) and of the ambient field (3,) since the baseline."""
        own = product(ambient_t, self.rotation).reshape(-1, 1)
        errors: Array = (
            product(change, self.by_pose.reshape(len(change), -1)).reshape(self.by_pose.shape[1:]) + own * self.by_field
        )
        return errors


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Of sensors that are well. noise_t (N, 3): white noise of one sample. lasting: None where nothing else is off."""

    noise_t: Array
    lasting: FieldErrors | None = None


def change_since(rest: State, state: State) -> Array:
    """(8,) change of position (m), of the axis in the rest axis's tangent plane (rad), and ambient field (T)."""
    return np.concatenate(
        [state.position_m - rest.position_m, product(tangent_basis(rest.axis).T, state.axis), state.ambient_t]
    )
