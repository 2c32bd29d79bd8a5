"""Algebra of small matrices with the same bits on every processor.

BLAS and LAPACK do not give that: OpenBLAS chooses its kernels by the processor, and they add in different orders. Here
every sum has one order (matrix.c), and only +, −, ×, ÷ and √ are used, which IEEE 754 rounds the same everywhere.
Matrices have up to about sixty rows; BLAS would not be faster for them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmfts.arithmetic import _arithmetic
from fmfts.arithmetic.elementary import log

Array = NDArray[np.float64]

# A singular value below this share of the largest, times the larger dimension, counts as zero (as in NumPy's rank).
ROUNDING = 2.0**-52
EIGEN_RESIDUAL = 1e-9  # largest |A·V − V·Λ| of valid eigenvectors, relative to the largest eigenvalue


class SingularError(ValueError):
    """A matrix is not positive definite, or not finite."""


def product(first: ArrayLike, *others: ArrayLike) -> Any:
    """first @ second @ …, from the left, with the shapes of NumPy's `@`: (…, m, k) · (…, k, n), or vectors.

    Returns a float for a product of two vectors, else an array.
    """
    value: Any = np.asarray(first, dtype=np.float64)
    for other in others:
        value = _product(value, np.asarray(other, dtype=np.float64))
    return value


def _product(a: Array, b: Array) -> Any:
    """Multiplies by one call of C for all shapes: the Python path of a frame spends most of its time here."""
    m, k = a.shape[-2:] if a.ndim > 1 else (1, len(a))
    inner, n = b.shape[-2:] if b.ndim > 1 else (len(b), 1)
    if k != inner:
        raise ValueError(f"cannot multiply {a.shape} by {b.shape}")
    batch, count = a.shape[:-2], 1
    if a.ndim > 2 or b.ndim > 2:
        if a.ndim > 2 and b.ndim > 2 and batch != b.shape[:-2]:
            batch = np.broadcast_shapes(batch, b.shape[:-2])
            a, b = np.broadcast_to(a, (*batch, m, k)), np.broadcast_to(b, (*batch, k, n))
        batch = batch or b.shape[:-2]
        count = math.prod(batch)
    out = np.empty(batch + a.shape[-2:-1] * (a.ndim > 1) + b.shape[-1:] * (b.ndim > 1))
    _arithmetic.product(count, m, k, n, np.ascontiguousarray(a), np.ascontiguousarray(b), out)
    return out if out.ndim else float(out)


def cholesky(matrix: Array) -> Array:
    """Lower triangle L with L·Lᵀ = `matrix` (…, n, n); SingularError unless it is positive definite."""
    lower: Array = np.array(matrix, dtype=np.float64, order="C")
    size = lower.shape[-1]
    if lower.size and not _arithmetic.cholesky(lower.size // (size * size), size, lower):
        kind = "positive definite" if np.isfinite(matrix).all() else "finite"
        raise SingularError(f"a matrix of {size} × {size} is not {kind}")
    return lower


def solve_lower(lower: Array, right: Array) -> Array:
    """L⁻¹ · `right`, for a lower triangle (n, n) and right (n,) or (n, columns); or (…, n, n) and (…, n, columns)."""
    return _solve(lower, right, _arithmetic.solve_lower)


def solve_lower_transposed(lower: Array, right: Array) -> Array:
    """L⁻ᵀ · `right`; shapes as in `solve_lower`."""
    return _solve(lower, right, _arithmetic.solve_lower_transposed)


def _solve(lower: Array, right: Array, overwrite: Callable[[int, int, int, Array, Array], object]) -> Array:
    x: Array = np.array(right, dtype=np.float64, order="C")
    if x.size:
        overwrite(*_sizes(lower, x), np.ascontiguousarray(lower), x)
    return x


def _sizes(lower: Array, x: Array) -> tuple[int, int, int]:
    """The number of triangles, the size n of each, and the columns of each right-hand side."""
    size = lower.shape[-1]
    if x.shape[: lower.ndim - 1] != lower.shape[:-1] or not lower.ndim - 1 <= x.ndim <= lower.ndim:
        raise ValueError(f"equations of {lower.shape} with a right-hand side of {x.shape}")
    return lower.size // (size * size), size, x.size * size // lower.size


def solve(matrix: Array, right: Array) -> Array:
    """matrix⁻¹ · `right` for a positive definite `matrix` (…, n, n); right as in `solve_lower`."""
    lower = cholesky(matrix)
    return solve_lower_transposed(lower, solve_lower(lower, right))


def inverse(matrix: Array) -> Array:
    """Inverse of a positive definite `matrix` (…, n, n); symmetric to the last bit."""
    one = np.eye(matrix.shape[-1])
    half = solve_lower(cholesky(matrix), one if matrix.ndim == 2 else np.broadcast_to(one, matrix.shape))
    inverted: Array = product(half.swapaxes(-1, -2), half)
    return inverted


def log_determinant(matrix: Array) -> float:
    """log det of a positive definite `matrix` (n, n)."""
    total = 0.0
    for pivot in np.diagonal(cholesky(matrix)).tolist():
        total += log(pivot)
    return 2.0 * total


def singular_values(matrix: Array) -> tuple[Array, Array, Array]:
    """Singular value decomposition: `matrix` (m, n) = U·diag(S)·Vᵀ. Returns U (m, n), S (n,) descending, V (n, n).

    M. R. Hestenes, "Inversion of matrices by biorthogonalization", J. SIAM 6 (1958) 51: rotates pairs of columns until
    all columns are orthogonal. A column of U is zero where its singular value is zero. Raises SingularError.
    """
    rotated: Array = np.array(matrix, dtype=np.float64, order="C")
    columns = rotated.shape[1]
    right: Array = np.empty((columns, columns))
    converged = _arithmetic.rotate_columns(len(rotated), columns, rotated, right)
    if not np.isfinite(rotated).all():
        raise SingularError(f"a matrix of {len(rotated)} × {columns} is not finite")
    if not converged:
        raise SingularError(f"the singular values of a matrix of {len(rotated)} × {columns} were not found")
    values = lengths(rotated.T)
    order = np.argsort(-values, kind="stable")
    values = values[order]
    return rotated[:, order] / np.where(values > 0.0, values, 1.0), values, right[:, order]


def eigen(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues (n,), ascending, and eigenvectors (n, n), as columns, of a symmetric `matrix`.

    Raises ValueError where two eigenvalues differ only in their sign; those of a covariance never do.
    """
    left, values, right = singular_values(matrix)
    signed = np.copysign(values, np.diagonal(product(left.T, right)))
    if np.abs(product(matrix, right) - right * signed).max(initial=0.0) > EIGEN_RESIDUAL * values.max(initial=0.0):
        raise ValueError("two eigenvalues of this matrix differ only in their sign")
    order = np.argsort(signed, kind="stable")
    return signed[order], right[:, order]


def least_squares(matrix: Array, right: Array) -> Array:
    """The shortest x that minimises |matrix·x − right|, for matrix (m, n) and right (m,) or (m, columns)."""
    answer: Array = product(pseudo_inverse(matrix)[1], right)
    return answer


def pseudo_inverse(matrix: Array) -> tuple[Array, Array]:
    """The column basis and the pseudo-inverse of `matrix` (m, n).

    Returns an orthonormal basis (m, n) of its columns, with zero columns beyond its rank, and the pseudo-inverse
    (n, m): its product with a right-hand side is the shortest least-squares solution.
    """
    left, values, right = singular_values(matrix)
    nonzero = values > ROUNDING * max(matrix.shape) * values.max(initial=0.0)
    left = np.where(nonzero, left, 0.0)
    inverse: Array = product(right / np.where(nonzero, values, 1.0), left.T)
    return left, inverse


def complement(matrix: Array) -> Array:
    """Orthonormal columns (m, m − n), orthogonal to the columns of `matrix` (m, n), n < m, of full rank."""
    reflected: Array = np.array(matrix, dtype=np.float64, order="C")
    rows, columns = reflected.shape
    out: Array = np.empty((rows, rows - columns))
    _arithmetic.complement(rows, columns, reflected, out)
    return out


def length(vector: Array) -> float:
    """√Σx² of `vector` (n,)."""
    return math.sqrt(product(vector, vector))


def lengths(vectors: Array) -> Array:
    """√Σx² along the last axis of `vectors` (…, n)."""
    square = np.zeros(vectors.shape[:-1])
    for component in np.moveaxis(vectors, -1, 0):
        square = square + component * component
    return np.sqrt(square)


def added(terms: Sequence[Array]) -> Array:
    """The sum of arrays of one shape, one after the other."""
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def root_of_squares(*parts: Any) -> Any:
    """√(a² + b² + …) of numbers or arrays: combines independent standard deviations."""
    square: Any = 0.0
    for part in parts:
        square = square + part * part
    return np.sqrt(square)
