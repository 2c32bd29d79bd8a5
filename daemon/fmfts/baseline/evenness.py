"""The variation of the ambient field's strength while the robot turned, without noise: by attitude and by place.

The field's strength at orientation k is |f_k| with f_k = (HᵀWH)⁻¹HᵀW(y_k − o), where H are the chips' sensitivities.
Noise contributes uᵀ(HᵀWH)⁻¹u/|f|² to the variance of its logarithm, with u = f/|f|. Steel that turns with the pad adds
a variation with the attitude: a quadratic form of u, because it multiplies the field by a matrix, and a linear one,
because the offsets o absorb a part of it. What remains varies with the pad's place: a workshop's field differs from
place to place, and determines the gains less well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import log, square
from fmfts.arithmetic.matrix import inverse, least_squares, lengths, product
from fmfts.baseline.recording import BaselineError

Array = NDArray[np.float64]

# In a workshop the strength of the field differs by this over the path of a turned pad. It changes smoothly: only this
# many of the orientations count as independent.
STRENGTH_DEVIATION, INDEPENDENT = 0.005, 10
# Limit of the part that depends on the attitude. The workshop's own part, which no gain explains, is below
# STRENGTH_DEVIATION; screws that reach three times that made a healthy sensor look faulty.
LARGEST_BY_ATTITUDE = 3.0 * STRENGTH_DEVIATION
# At this limit the field's strength determines gains to 3 % (with INDEPENDENT orientations), hardly better than a
# chip's tolerance. A real board that was waved by hand met 3.6 % (tests/unit/test_turn_of_real_boards.py).
LARGEST_BY_PLACE = 0.1
STEEL_TURNS = (
    "Steel turns with the pad, as screws in its mount do, or stands near: move it 30 mm away from the sensors, and "
    "turn again; the bare and rest baselines are not affected"
)


def unevenness(reported: Array, by_field: Array, deviation: Array) -> float:
    """How much the field's strength differs from place to place: relative deviation, at least STRENGTH_DEVIATION.

    reported (K, N, 3): without offsets. by_field (N, 3, 3): what the chips report of unit fields. deviation (N, 3).
    BaselineError if the strength varies more with attitude than in a workshop, or too much with place.
    """
    matrix = (by_field / deviation[:, :, None]).reshape(-1, 3)
    covariance = inverse(product(matrix.T, matrix))
    field = product((reported / deviation).reshape(len(reported), -1), matrix, covariance)
    sizes = lengths(field)
    unit = field / sizes[:, None]
    by_noise = float(((product(unit, covariance) * unit).sum(axis=1) / square(sizes)).mean())
    strength = np.array([log(size) for size in sizes])
    strength = strength - strength.mean()
    by_attitude = _attitude_terms(unit)
    left = strength - product(by_attitude, least_squares(by_attitude, strength))
    whole = max(_variance(strength, 1) - by_noise, 0.0)
    by_place = min(max(_variance(left, by_attitude.shape[1]) - by_noise, 0.0), whole)
    _require(float(np.sqrt(whole - by_place)), float(np.sqrt(by_place)))
    return max(float(np.sqrt(by_place)), STRENGTH_DEVIATION)


def _attitude_terms(unit: Array) -> Array:
    """(K, 9) of unit vectors (K, 3): one, the three linear terms, and the five quadratic ones that are not one."""
    x, y, z = unit.T
    return np.column_stack([np.ones(len(unit)), unit, x * y, y * z, z * x, square(x), square(y)])


def _variance(values: Array, fitted: int) -> float:
    return float(square(values).sum() / max(len(values) - fitted, 1))


def _require(by_attitude: float, by_place: float) -> None:
    """BaselineError if the strength (relative deviations) depends on attitude or place more than a turn allows."""
    stronger = "the ambient field became stronger and weaker by"
    if by_attitude > LARGEST_BY_ATTITUDE:
        raise BaselineError(
            f"{stronger} {by_attitude * 1e2:.1f} % (mean) with the robot's attitude, where "
            f"{STRENGTH_DEVIATION * 1e2:.1f} % is usual. {STEEL_TURNS}"
        )
    if by_place > LARGEST_BY_PLACE:
        raise BaselineError(
            f"{stronger} {by_place * 1e2:.0f} % (mean) from place to place, where {STRENGTH_DEVIATION * 1e2:.1f} % "
            "is usual: turn the robot in one place, away from steel furniture and motors"
        )
