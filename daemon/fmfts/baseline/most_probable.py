"""The most probable unknowns of a mounting, of one magnet or several: Gauss–Newton with the tolerances as priors."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.matrix import product, solve
from fmfts.baseline.presses import PressBundle

Array = NDArray[np.float64]

ITERATIONS = 30
SETTLED = 1e-6  # the search ends when no step is larger, in prior deviations


class MountingUnknowns(Protocol):
    """deviation (M,): of the prior, in SI. precision (M, M): of the prior, in these deviations."""

    @property
    def deviation(self) -> Array: ...
    @property
    def precision(self) -> Array: ...
    def predicted(self, scaled: Array) -> tuple[Array, Array]:
        """Field (N, 3) as the chips report it, and its derivative (3N, M) in SI. scaled (M,): in prior deviations."""


def most_probable(
    unknowns: MountingUnknowns,
    data: Array,
    weight: Array,
    start: Array,
    bundle: PressBundle | None = None,
    iterations: int = ITERATIONS,
) -> tuple[Array, Array]:
    """The unknowns (M,) with the largest posterior, in prior deviations, and the normal matrix (M, M) there.

    data (N, 3) has the weights (3N,). The poses of the presses in `bundle` are updated too.
    """
    scaled = start
    for _ in range(iterations):
        predicted, jacobian = unknowns.predicted(scaled)
        weighted = weight[:, None] * jacobian * unknowns.deviation
        normal = product(weighted.T, weighted) + unknowns.precision
        gradient = product(weighted.T, weight * (data - predicted).ravel()) - product(unknowns.precision, scaled)
        if bundle is not None:
            reduced = bundle.linearise(scaled)
            normal, gradient = normal + reduced.normal, gradient + reduced.gradient
        step = solve(normal, gradient)
        # The linear model does not hold over more than a few prior deviations.
        step *= min(1.0, 2.0 / max(float(np.abs(step).max()), SETTLED))
        scaled = scaled + step
        if bundle is not None:
            bundle.follow(step)
        if np.abs(step).max() < SETTLED:
            break
    return scaled, normal
