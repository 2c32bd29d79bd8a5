"""What solver.py computes from a normal matrix: a damped step, an inverse, the weakest direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmfts.arithmetic.elementary import square
from fmfts.arithmetic.matrix import SingularError, cholesky, eigen, product, solve_lower

Array = NDArray[np.float64]

# A column is not measured if the others explain all of its variance but this share, which is rounding.
SINGULAR = 1e-11


def damped_step(normal: Array, gradient: Array, damping: float) -> tuple[Array | None, float]:
    """Marquardt's step, and the decrease of χ² that the linear model predicts for it; None if A is singular."""
    damped = normal + damping * np.diag(np.diagonal(normal))
    inverse = inverse_of(damped)
    if inverse is None:
        return None, np.inf
    step = product(inverse, gradient)
    return step, product(step, gradient) + damping * product(step * step, np.diagonal(normal))


def inverse_of(matrix: Array) -> Array | None:
    """Inverse of a symmetric matrix; None unless it is positive definite and clearly not singular."""
    diagonal = np.diagonal(matrix)
    if not (np.isfinite(matrix).all() and (diagonal > 0.0).all()):
        return None
    scale = 1.0 / np.sqrt(diagonal)
    try:
        factor = cholesky(matrix * scale[:, None] * scale)
    except SingularError:
        return None
    if (square(np.diagonal(factor)) < SINGULAR).any():
        return None
    half = solve_lower(factor, np.eye(len(factor))) * scale
    inverse: Array = product(half.T, half)
    return inverse


def weakest_step(normal: Array, columns: NDArray[np.intp], size: int) -> Array:
    """The unit step (size,) that changes the residuals least, each column in units of its own deviation."""
    diagonal = np.diagonal(normal)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    _, vectors = eigen(normal * scale[:, None] * scale)
    direction = np.zeros(size)
    direction[columns] = vectors[:, 0]
    return direction
