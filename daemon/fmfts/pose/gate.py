"""The gate: whether a frame fits a plausible pose of the pad's magnet."""

from __future__ import annotations

import numpy as np

from fmfts.arithmetic.elementary import log, square
from fmfts.arithmetic.matrix import length
from fmfts.common.chi2 import quantile, survival
from fmfts.pose.problem import Status
from fmfts.pose.solver import PoseEstimate
from fmfts.pose.state import POSITION, State

# The share of healthy frames that the χ² gate rejects. At 220 Hz, one frame in an hour would be 1.3e-6.
FALSE_ALARM = 1e-6
# A magnet that is further from rest than this, or whose moment is off by this factor, is not the pad's.
REACH_M = 8e-3
LOG_MOMENT_REACH = log(3.0)
# No magnet becomes stronger than at its baseline, but for the cold (2.4 % in 20 K) and errors of calibration (1.3 %
# under a press, of gains good to 5 %). Steel above it looks just like that: like a stronger magnet, farther away.
STRONGER = log(1.05)
# A position that is known no better than this cannot be used: contact is not linear over it.
VAGUE_M = 1e-3


def is_plausible(estimate: PoseEstimate, rest: State, strongest: float = LOG_MOMENT_REACH) -> bool:
    """Whether the solve converged to a pose that this pad's magnet can have, and that is known well enough.

    strongest: the largest log moment, above that of `rest`: STRONGER where a baseline tells the moment.
    """
    return (
        estimate.status is Status.CONVERGED
        and length(estimate.position_m - rest.position_m) < REACH_M
        and float(np.trace(estimate.covariance[POSITION, POSITION])) < square(VAGUE_M)
        and -LOG_MOMENT_REACH < estimate.state.log_moment - rest.log_moment < strongest
    )


def probability(estimate: PoseEstimate, rest: State) -> float:
    """The probability that a healthy frame has a larger χ² than this one; zero without a plausible pose."""
    if not is_plausible(estimate, rest):
        return 0.0
    return survival(estimate.chi2, estimate.degrees_of_freedom)


def fits(estimate: PoseEstimate, rest: State, strongest: float = LOG_MOMENT_REACH) -> bool:
    """Whether the pose is plausible and the frame's χ² passes the gate."""
    return is_plausible(estimate, rest, strongest) and estimate.chi2 < quantile(
        FALSE_ALARM, estimate.degrees_of_freedom
    )
