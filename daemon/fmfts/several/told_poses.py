"""Where the magnets are as fingers put them: by the table of presses, not solved by themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import added, product
from fmfts.pose.magnets import CHANGE, Magnets
from fmfts.several.compiled import _several, doubles, finite, room
from fmfts.several.field_model import FieldModel

Array = NDArray[np.float64]


def told_poses(model: FieldModel, fingers: Array, covariance: Array) -> tuple[Magnets, Array]:
    """The magnets under `fingers` (K, 3), and the variances (M, 5) of their poses by `covariance` (3K, 3K) of those."""
    if not (model.compiled and room(fingers=len(fingers))):
        return reference_told_poses(model, fingers, covariance)
    rest = model.mounting.magnets
    count = len(rest)
    position, axis, variance = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, CHANGE))
    if not _several.told_poses(
        model.packed, model.work, doubles(fingers), doubles(covariance), position, axis, variance
    ):
        finite(fingers=fingers)
    return replace(rest, position_m=position, axis=axis), variance


def reference_told_poses(model: FieldModel, fingers: Array, covariance: Array) -> tuple[Magnets, Array]:
    """told_poses() in NumPy."""
    predicted, mounting = model.predict(fingers), model.mounting
    by_finger = model.by_finger(predicted)
    each = product(by_finger, covariance) * by_finger
    variance = added([np.zeros(len(each)), *each.T])
    return mounting.magnets.changed(predicted.change, mounting.frames), variance.reshape(-1, CHANGE)
