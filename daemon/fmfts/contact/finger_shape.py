"""How far the answer is off where the finger has another shape than the probe that calibrated the pad.

A small area of contact moves the magnet like the mean of presses at its points. So to second order only the area's
second moments count: how wide it is along x and along y. The response, which the model file holds, tells what they do.
"""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product
from fmfts.contact.contract import Facts
from fmfts.contact.response import Response, answer_by_change
from fmfts.pad import Array

# Deviation of a finger's second moments from the probe's, mm²: of discs, 6 mm wide, 7.5 and 4 mm are so far off. Then a
# flat face of 10 × 10 mm is within five deviations.
MOMENT_MM2 = 1.3
AWAY_MM = np.sqrt(MOMENT_MM2)
# Weights of a pose's change, mm and rad: its deviations at rest, between those of six unknowns and of eight.
POSE_DEVIATION = np.array([0.012, 0.012, 0.005, 0.0027, 0.0027])
DIAGONAL = np.sqrt(0.5)
DIRECTIONS = np.array([[1.0, 0.0], [DIAGONAL, DIAGONAL], [0.0, 1.0], [-DIAGONAL, DIAGONAL]])


def shape_deviation_of(facts: Facts, response: Response) -> Array:
    """`shape_deviation` in the bins of a model's own error (forces, radii, outputs)."""
    limit_n, widest_mm = facts.envelope.force_max_n, facts.envelope.x_mm[1]
    # The last bins have no end: take the largest calibrated force, and the edge.
    force_n = np.append(np.minimum(facts.own_error.force_n[:-1], limit_n), limit_n)
    radius_mm = np.append(np.minimum(facts.own_error.radius_mm[:-1], widest_mm), widest_mm)
    return shape_deviation(response, force_n, radius_mm)[:, :, : len(facts.outputs)]


def shape_deviation(response: Response, force_n: Array, radius_mm: Array) -> Array:
    """Deviation (F, R, 2 + L) of place (mm) and loads (N), for forces (F,) and distances from the middle (R,).

    Two causes, each of one deviation: both moments larger by MOMENT_MM2, and one larger and the other smaller.
    """
    place = (radius_mm[:, None, None] * np.concatenate([DIRECTIONS, -DIRECTIONS])).reshape(-1, 2)
    presses = np.zeros((len(force_n), len(place), 2 + response.loads))
    presses[:, :, :2], presses[:, :, 2] = place, force_n[:, None]
    press: Array = presses.reshape(-1, 2 + response.loads)
    change, slope = response.change_and_slope(press)
    answer = answer_by_change(slope, np.tile(np.diag(square(POSE_DEVIATION)), (len(press), 1, 1)))
    variance = np.zeros(press.shape)
    along_x, along_y = (_second_order(response, press, change, axis) for axis in range(2))
    for cause in (along_x + along_y, along_x - along_y):
        variance += square(product(answer, cause[:, :, None])[:, :, 0])
    shape = (len(force_n), len(radius_mm), 2 * len(DIRECTIONS), press.shape[-1])
    return np.asarray(np.sqrt(np.mean(variance.reshape(shape), axis=2)), dtype=np.float64)


def _second_order(response: Response, press: Array, change: Array, axis: int) -> Array:
    """What a finger that is wider by MOMENT_MM2 along one axis adds to `change` (K, 5)."""
    away = np.zeros(press.shape[1])
    away[axis] = AWAY_MM
    more, less = (response.change_and_slope(press + side * away)[0] for side in (1.0, -1.0))
    return np.asarray((more + less) / 2.0 - change, dtype=np.float64)
