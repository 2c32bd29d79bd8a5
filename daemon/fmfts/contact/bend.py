"""How much a contact model bends over the deviations of a pose: its slopes at a larger force.

A force grows faster than the displacement. Where the true force is larger than the model's answer, the slope of the
answer is too small, and so is the deviation that it carries over from the pose. So the mean of two slopes counts: that
of the answer, and that of a force which is larger by BEND_DEVIATIONS. By the trapezium rule this is the slope of the
chord between both. Where the true force is smaller, the deviation is a little too large.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product
from fmfts.contact.estimate import doubt
from fmfts.pad import Array

BEND_DEVIATIONS = 3.0
# If the force's deviation is a smaller share of it, the bend makes no deviation larger by more than a twentieth.
STRAIGHT_SHARE = 0.02


def larger_force(pose_covariance: Array, contact: Array, jacobian: Array, carried: Array) -> Array | None:
    """How far (6,) the most likely pose of the larger force is from the pose of the answer; None if no bend matters.

    contact (m,), jacobian (m, 6), carried (m, m): the model's answer, its slopes, and the covariance that these carry
    over from `pose_covariance` (6, 6). Where noise may be all of the force, it has no place and its bend means nothing.
    """
    force_n, variance = float(contact[2]), float(carried[2, 2])
    if not variance > square(STRAIGHT_SHARE * force_n) or not doubt(force_n, variance) < 1.0:
        return None
    away: Array = product(pose_covariance, jacobian[2]) * (BEND_DEVIATIONS / sqrt(variance))
    return away


def bend_of(pose_covariance: Array, jacobian: Array, ahead: Array, carried: Array) -> Array:
    """(m,) at least 1: the factor of each variance in `carried`. ahead (m, 6): the slopes at the larger force."""
    mean = 0.5 * (jacobian + ahead)
    bent, straight = np.diagonal(product(mean, pose_covariance, mean.T)), np.diagonal(carried)
    factor: Array = np.where(bent > straight, bent / np.where(straight > 0.0, straight, 1.0), 1.0)
    return factor
