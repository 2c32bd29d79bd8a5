"""Solves for a pad's magnet from one field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import exp
from fmfts.arithmetic.matrix import product
from fmfts.pad import Magnet, Pad
from fmfts.pose.kernel import solve_problem
from fmfts.pose.problem import (
    STOP_CHI2,
    Parts,
    Prior,
    Problem,
    Solution,
    Status,
    magnet_rows,
    measurement_rows,
    parts_of,
)
from fmfts.pose.state import State, tangent_basis
from fmfts.sensor.chips import NOISE_T

__all__ = ["FREE_FIELD", "FREE_PAPER", "FREE_POSE", "PoseEstimate", "Status", "estimate_of", "solve"]

Array = NDArray[np.float64]

FREE_POSE = np.arange(5)  # the moment is known
FREE_PAPER = np.arange(6)  # the paper's six unknowns: position, and a moment of free direction and length
FREE_FIELD = np.array([0, 1, 2, 3, 4, 6, 7, 8])  # the moment is known, but not the ambient field


@dataclass(frozen=True, slots=True)
class PoseEstimate(Solution):
    """A `Solution` for a pad's magnet. remanence_t: the length of the moment as remanence; NaN without an estimate."""

    remanence_t: float

    @property
    def position_m(self) -> Array:
        return self.state.position_m

    @property
    def axis(self) -> Array:
        return self.state.axis

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of (position_m, axis), as the contact model needs it. The axis part has rank two."""
        spread = np.zeros((6, 5))
        spread[:3, :3] = np.eye(3)
        spread[3:, 3:] = tangent_basis(self.state.axis)
        covariance: Array = product(spread, self.covariance[:5, :5], spread.T)
        return covariance


def solve(
    field_t: Array,
    pad: Pad,
    start: State | None = None,
    *,
    deviation_t: Array | float = NOISE_T,
    proportional: float = 0.0,
    age_s: Array | float = 0.0,
    free: NDArray[np.intp] = FREE_PAPER,
    parts: Parts | None = None,
    prior: Prior | None = None,
    octupole: bool | None = None,
    neighbours: Sequence[Magnet] = (),
    stop_chi2: float = STOP_CHI2,
) -> PoseEstimate:
    """Estimate the magnet's state from one field.

    field_t (N, 3): in each sensor's own axes, ambient subtracted; NaN leaves an axis out. deviation_t: (N, 3) or one
    number, standard deviation of each axis; `proportional` of the value is added in square. Infinite leaves an axis
    out; zero, negative or NaN is INVALID. age_s (N,): age of each sensor's sample.
    start: the rest pose if None. free: the columns of the step that are unknown; the others keep the start's value.
    parts (columns,): replaces `free`, and can also name parts that are considered or have a prior.
    octupole: True treats magnets as cylinders, False as dipoles, None as they are described.
    neighbours: the magnets of the start's neighbours.
    stop_chi2: see STOP_CHI2, STOP_CONVERGED.

    With the default unknowns, equal deviations and dipoles this is the paper's method (Eq. 9–10): it minimises twelve
    differences from the rest pose. (The three sums of Eq. 8, taken literally, are three equations for six unknowns.)
    """
    state = State.at_rest(pad) if start is None else start
    solution = solve_problem(
        Problem(
            measurements=measurement_rows(field_t, pad.sensors, deviation_t, proportional, age_s),
            magnets=magnet_rows(pad.magnet, *neighbours, octupole=octupole),
            parts=parts_of(state.columns, free=free) if parts is None else parts,
            start=state,
            prior=prior,
            stop_chi2=stop_chi2,
        )
    )
    return estimate_of(solution, pad.magnet)


def estimate_of(solution: Solution, magnet: Magnet) -> PoseEstimate:
    """Add the remanence that a magnet of this size needs for the solved moment."""
    solved = solution.status in (Status.CONVERGED, Status.AT_LIMIT)
    remanence_t = magnet.remanence_t * exp(solution.state.log_moment) if solved else float("nan")
    return PoseEstimate(
        solution.state,
        solution.covariance,
        solution.chi2,
        solution.rows,
        solution.unknowns,
        solution.residual_t,
        solution.iterations,
        solution.status,
        solution.direction,
        remanence_t,
    )
