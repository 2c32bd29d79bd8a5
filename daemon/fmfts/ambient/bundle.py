"""Least squares over many blocks: each has unknowns of its own, and all share others (a bundle adjustment)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reduced:
    """Linear equations own·x_k + shared·s = residual of K blocks, the x_k eliminated (Schur's complement).

    normal (M, M), gradient (M,): of the shared unknowns. block_chi2 (K,): what the x_k leave of each residual.
    """

    normal: Array
    gradient: Array
    block_chi2: Array
    _basis: Array
    _triangle: Array
    _shared: Array
    _residual: Array

    @classmethod
    def of(cls, own: Array, shared: Array, residual: Array) -> Self:
        """own (K, R, P), shared (K, R, M), residual (K, R), all in standard deviations; R > P."""
        # What is perpendicular to a block's own columns is all that it can say of the shared unknowns.
        basis, triangle = np.linalg.qr(own)
        across = basis.transpose(0, 2, 1)
        left = (shared - basis @ (across @ shared)).reshape(-1, shared.shape[2])
        misfit = residual - (basis @ (across @ residual[:, :, None]))[:, :, 0]
        return cls(left.T @ left, left.T @ misfit.ravel(), (misfit**2).sum(axis=1), basis, triangle, shared, residual)

    def own_steps(self, shared_step: Array) -> Array:
        """(K, P) the blocks' own unknowns that go with a step (M,) of the shared ones."""
        left = self._residual - self._shared @ shared_step
        steps = np.linalg.solve(self._triangle, self._basis.transpose(0, 2, 1) @ left[:, :, None])
        return np.asarray(steps[:, :, 0], dtype=np.float64)
