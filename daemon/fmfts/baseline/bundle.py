"""Least squares over many blocks: each has unknowns of its own, and all share others (a bundle adjustment)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import product, pseudo_inverse

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reduced:
    """Linear equations own·x_k + shared·s = residual of K blocks, the x_k eliminated (Schur's complement).

    normal (M, M), gradient (M,): of the shared unknowns. block_chi2 (K,): what the x_k leave of each residual.
    """

    normal: Array
    gradient: Array
    block_chi2: Array
    _own_answer: Array
    _shared: Array
    _residual: Array

    @classmethod
    def of(cls, own: Array, shared: Array, residual: Array) -> Self:
        """own (K, R, P), shared (K, R, M), residual (K, R), all in standard deviations; R > P."""
        # What is perpendicular to a block's own columns is all that it can say of the shared unknowns.
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
        """(K, P) the blocks' own unknowns that go with a step (M,) of the shared ones."""
        left = self._residual - product(self._shared, shared_step)
        steps: Array = product(self._own_answer, left[:, :, None])[:, :, 0]
        return steps
