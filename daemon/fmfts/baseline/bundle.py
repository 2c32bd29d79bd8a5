"""Least squares over many blocks. Each block has its own unknowns, and all share others (a bundle adjustment)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product, pseudo_inverse

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reduced:
    """Linear equations own·x_k + shared·s = residual of K blocks, with the x_k eliminated (Schur complement).

    normal (M, M) and gradient (M,) are for the shared unknowns s. block_chi2 (K,): χ² of each block after fitting x_k.
    """

    normal: Array
    gradient: Array
    block_chi2: Array
    _own_answer: Array
    _shared: Array
    _residual: Array

    @classmethod
    def of(cls, own: Array, shared: Array, residual: Array) -> Reduced:
        """own (K, R, P), shared (K, R, M), residual (K, R), all in standard deviations; R > P."""
        # Only the part perpendicular to a block's own columns determines the shared unknowns.
        basis, own_answer = (np.stack(parts) for parts in zip(*map(pseudo_inverse, own), strict=True))
        across = basis.transpose(0, 2, 1)
        left = (shared - product(basis, product(across, shared))).reshape(-1, shared.shape[2])
        misfit = residual - product(basis, product(across, residual[:, :, None]))[:, :, 0]
        return cls(
            product(left.T, left),
            product(left.T, misfit.ravel()),
            square(misfit).sum(axis=1),
            own_answer,
            shared,
            residual,
        )

    def own_steps(self, shared_step: Array) -> Array:
        """(K, P) steps of the blocks' own unknowns that belong to a step (M,) of the shared ones."""
        left = self._residual - product(self._shared, shared_step)
        steps: Array = product(self._own_answer, left[:, :, None])[:, :, 0]
        return steps
