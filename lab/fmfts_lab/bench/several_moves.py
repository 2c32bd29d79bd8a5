"""What moves magnets besides the places and forces of the fingers: the equations of field_model.py in NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import added, product
from fmfts.contact.array_response import Pressed
from fmfts.several.field_model import FINGER, PATCH_MM2, SUM_ERROR_PER_N, FieldModel, Predicted

Array = NDArray[np.float64]


def by_finger(model: FieldModel, predicted: Predicted) -> Array:
    """(5M, 3K) the derivative of the change of the poses by the fingers."""
    slopes = [one.slope for one in predicted.pressed] or [np.zeros((len(model._si), 0))]
    by_finger: Array = np.concatenate(slopes, axis=1) * model._si[:, None]
    return by_finger


def considered_moves(model: FieldModel, fingers: Array, predicted: Predicted) -> Array:
    """The movements (5M, C) of the poses by other causes than the places and forces of the fingers, one deviation each,
    in SI.
    """
    if not len(fingers):
        return np.zeros((len(model._si), 0))
    of_table = np.diag(response_error(model, fingers, predicted))
    each: Array = model._si[:, None] * np.concatenate([moves(model, fingers, predicted), of_table], axis=1)
    return each


def moves(model: FieldModel, fingers: Array, predicted: Predicted) -> Array:
    """(5M, 3K + 2M) as `considered_moves`, without the errors of the table, in the response's units."""
    causes = []
    for (_, _, force), one in zip(fingers.tolist(), predicted.pressed, strict=True):
        causes += [model.scene.friction * force * one.by_shear, 0.5 * PATCH_MM2 * one.laplacian[:, None]]
    moved = [_by_place(model, one) for one in predicted.pressed]
    return np.concatenate([*causes, product(added(moved), model._off_root_mm)], axis=1)


def _by_place(model: FieldModel, one: Pressed) -> Array:
    """(5M, 2M) derivative of a change by the magnets' places, in mm."""
    count = len(model._off_mm)
    slope = one.slope.reshape(count, -1, FINGER)
    by_place = np.zeros((count, slope.shape[1], count, 2))
    for magnet in range(count):
        by_place[magnet, :, magnet] = -slope[magnet, :, :2]
    return by_place.reshape(count * slope.shape[1], 2 * count)


def response_error(model: FieldModel, fingers: Array, predicted: Predicted) -> Array:
    """(5M,) deviation of each number of pose, in the response's units."""
    variance = np.zeros(len(model._si))
    for one in predicted.pressed:
        variance = variance + square(model.response.error * one.change)
    for i, one in enumerate(predicted.pressed):
        for j, other in enumerate(predicted.pressed[:i]):
            both = np.abs(one.change) * fingers[j, 2] + np.abs(other.change) * fingers[i, 2]
            variance = variance + square(0.5 * SUM_ERROR_PER_N * both)
    return np.sqrt(variance)
