"""The field of a pad whose magnets have moved, by NumPy: several/free_poses.c has the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.pose.magnets import CHANGE, field_and_slope
from fmfts.several.field_model import FieldModel, Predicted
from fmfts.several.free_poses import HALF_A_PRESS_M

Array = NDArray[np.float64]


def at(model: FieldModel, change: Array) -> Predicted:
    """The field's change when magnets have moved by `change` (5M,). Errors are computed for its `change`."""
    mounting = model.mounting
    moved = mounting.magnets.changed(change, mounting.frames)
    field, by_pose = field_and_slope(moved, mounting.frames, mounting.sensors)
    return Predicted(field.ravel() - model.at_rest, np.zeros((field.size, 0)), by_pose, counted(model, change), ())


def counted(model: FieldModel, change: Array) -> Array:
    """(5M,) the change for which the baseline's errors are computed. They are computed for a magnet that is
    HALF_A_PRESS down. One that is pressed by d is d/2 down on the way, nearer to the chips: the slope of a dipole's
    gradient goes with r⁻⁵."""
    heights = model.mounting.sensors.position_m[:, 2].tolist()
    base_m, counted = sum(heights) / len(heights), change.copy()
    for number, place_m in enumerate(model.mounting.magnets.position_m[:, 2].tolist()):
        first, above_m = CHANGE * number, place_m - base_m
        down_m = min(float(change[first + 2]), 0.0)
        nearer = (above_m - HALF_A_PRESS_M) / max(above_m + 0.5 * down_m, 0.25 * above_m)
        square = nearer * nearer
        counted[first : first + CHANGE] *= square * square * nearer
    return counted
