"""Algebra of small matrices, the same to the last bit on every processor.

BLAS and LAPACK are not: OpenBLAS picks other kernels on another processor, and they add in another order. Here every
sum has one order, the same in matrix.c and in matrix_reference.py, and nothing is used but +, −, ×, ÷ and √, which
IEEE 754 rounds the same everywhere. Matrices are of up to some sixty rows, which no kernel of a BLAS would speed up.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fmfts.arithmetic import matrix_reference as reference
from fmfts.arithmetic.compiled import AVAILABLE, _arithmetic
from fmfts.arithmetic.elementary import log

Array = NDArray[np.float64]

# A singular value below this share of the largest is rounding (times the larger dimension): as LAPACK's users have it.
ROUNDING = 2.0**-52
UNRESOLVED = 1e-9


class SingularError(ValueError):
    """A matrix is not positive definite, or not finite."""


def product(first: ArrayLike, *others: ArrayLike) -> Any:
    """first @ second @ …, from the left, each as NumPy's `@` has it: (…, m, k) · (…, k, n), vectors too.

    A number where both are vectors, else an array.
    """
    value: Any = np.asarray(first, dtype=np.float64)
    for other in others:
        value = _product(value, np.asarray(other, dtype=np.float64))
    return value


def _product(a: Array, b: Array) -> Any:
    """One call of C, whatever the shapes: this is what a frame's time in Python goes into."""
    m, k = a.shape[-2:] if a.ndim > 1 else (1, len(a))
    inner, n = b.shape[-2:] if b.ndim > 1 else (len(b), 1)
    if k != inner:
        raise ValueError(f"a product of {a.shape} and {b.shape}")
    batch, count = a.shape[:-2], 1
    if a.ndim > 2 or b.ndim > 2:
        if a.ndim > 2 and b.ndim > 2 and batch != b.shape[:-2]:
            batch = np.broadcast_shapes(batch, b.shape[:-2])
            a, b = np.broadcast_to(a, (*batch, m, k)), np.broadcast_to(b, (*batch, k, n))
        batch = batch or b.shape[:-2]
        count = math.prod(batch)
    out = np.empty(batch + a.shape[-2:-1] * (a.ndim > 1) + b.shape[-1:] * (b.ndim > 1))
    if AVAILABLE:
        _arithmetic.product(count, m, k, n, np.ascontiguousarray(a), np.ascontiguousarray(b), out)
    else:
        left, right = a if a.ndim > 1 else a[None], b if b.ndim > 1 else b[:, None]
        out[...] = reference.product(left, right).reshape(out.shape)
    return out if out.ndim else float(out)


def cholesky(matrix: Array) -> Array:
    """Lower triangle L with L·Lᵀ = `matrix` (…, n, n); SingularError unless it is positive definite."""
    lower: Array = np.array(matrix, dtype=np.float64, order="C")
    size = lower.shape[-1]
    if AVAILABLE:
        good = not lower.size or _arithmetic.cholesky(lower.size // (size * size), size, lower)
    else:
        good = all(reference.cholesky(one) for one in _each(lower))
    if not good:
        kind = "positive definite" if np.isfinite(matrix).all() else "finite"
        raise SingularError(f"a matrix of {size} × {size} is not {kind}")
    return lower


def solve_lower(lower: Array, right: Array) -> Array:
    """L⁻¹ · `right`. lower (n, n): a triangle, and right (n,) or (n, columns); or (…, n, n) and (…, n, columns)."""
    x: Array = np.array(right, dtype=np.float64, order="C")
    if not x.size:
        return x
    if AVAILABLE:
        _arithmetic.solve_lower(*_sizes(lower, x), np.ascontiguousarray(lower), x)
    else:
        for one, values in zip(_each(lower), _columns_of(lower, x), strict=True):
            reference.solve_lower(one, values)
    return x


def solve_lower_transposed(lower: Array, right: Array) -> Array:
    """L⁻ᵀ · `right`."""
    x: Array = np.array(right, dtype=np.float64, order="C")
    if not x.size:
        return x
    if AVAILABLE:
        _arithmetic.solve_lower_transposed(*_sizes(lower, x), np.ascontiguousarray(lower), x)
    else:
        for one, values in zip(_each(lower), _columns_of(lower, x), strict=True):
            reference.solve_lower_transposed(one, values)
    return x


def _sizes(lower: Array, x: Array) -> tuple[int, int, int]:
    """How many triangles, their size, and the columns of each one's right-hand side."""
    size = lower.shape[-1]
    if x.shape[: lower.ndim - 1] != lower.shape[:-1] or not lower.ndim - 1 <= x.ndim <= lower.ndim:
        raise ValueError(f"equations of {lower.shape} with a right-hand side of {x.shape}")
    return lower.size // (size * size), size, x.size * size // lower.size


def _each(matrices: Array) -> Array:
    return matrices.reshape(-1, *matrices.shape[-2:]) if matrices.size else matrices[:0]


def _columns_of(lower: Array, x: Array) -> Array:
    count, size, columns = _sizes(lower, x)
    return x.reshape(count, size, columns)


def solve(matrix: Array, right: Array) -> Array:
    """matrix⁻¹ · `right`, of a positive definite `matrix` (…, n, n); right as in `solve_lower`."""
    lower = cholesky(matrix)
    return solve_lower_transposed(lower, solve_lower(lower, right))


def inverse(matrix: Array) -> Array:
    """Of a positive definite `matrix` (…, n, n); symmetric to the last bit."""
    one = np.eye(matrix.shape[-1])
    half = solve_lower(cholesky(matrix), one if matrix.ndim == 2 else np.broadcast_to(one, matrix.shape))
    inverted: Array = product(half.swapaxes(-1, -2), half)
    return inverted


def log_determinant(matrix: Array) -> float:
    """Of a positive definite `matrix` (n, n)."""
    total = 0.0
    for root in np.diagonal(cholesky(matrix)).tolist():
        total += log(root)
    return 2.0 * total


def singular_values(matrix: Array) -> tuple[Array, Array, Array]:
    """U (m, n), S (n,), V (n, n) with `matrix` (m, n) = U·diag(S)·Vᵀ, the largest of S first.

    M. R. Hestenes, "Inversion of matrices by biorthogonalization", J. SIAM 6 (1958) 51: pairs of columns are turned
    until all are orthogonal. A column of U whose singular value is zero is zero.
    """
    turned: Array = np.array(matrix, dtype=np.float64, order="C")
    columns = turned.shape[1]
    right: Array = np.empty((columns, columns))
    ended = (
        _arithmetic.rotate_columns(len(turned), columns, turned, right)
        if AVAILABLE
        else reference.rotate_columns(turned, right)
    )
    if not np.isfinite(turned).all():
        raise SingularError(f"a matrix of {len(turned)} × {columns} is not finite")
    if not ended:
        raise SingularError(f"the singular values of a matrix of {len(turned)} × {columns} were not found")
    values = lengths(turned.T)
    order = np.argsort(-values, kind="stable")
    values = values[order]
    return turned[:, order] / np.where(values > 0.0, values, 1.0), values, right[:, order]


def eigen(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues (n,), the smallest first, and eigenvectors (n, n) in columns, of a symmetric `matrix`.

    ValueError where two eigenvalues differ in their sign alone, which those of a covariance never do.
    """
    left, values, right = singular_values(matrix)
    signed = np.copysign(values, np.diagonal(product(left.T, right)))
    if np.abs(product(matrix, right) - right * signed).max(initial=0.0) > UNRESOLVED * values.max(initial=0.0):
        raise ValueError("a matrix with two eigenvalues that differ in their sign alone")
    order = np.argsort(signed, kind="stable")
    return signed[order], right[:, order]


def least_squares(matrix: Array, right: Array) -> Array:
    """The shortest x that makes |matrix·x − right| least: matrix (m, n), right (m,) or (m, columns)."""
    answer: Array = product(pseudo_inverse(matrix)[1], right)
    return answer


def pseudo_inverse(matrix: Array) -> tuple[Array, Array]:
    """An orthonormal basis (m, n) of the columns of `matrix` (m, n), with zeros for what the others have already, and
    the matrix (n, m) that makes the shortest least-squares answer of a right-hand side."""
    left, values, turned = singular_values(matrix)
    known = values > ROUNDING * max(matrix.shape) * values.max(initial=0.0)
    left = np.where(known, left, 0.0)
    inverse: Array = product(turned / np.where(known, values, 1.0), left.T)
    return left, inverse


def complement(matrix: Array) -> Array:
    """(m, m − n): orthonormal columns, orthogonal to those of `matrix` (m, n) of full rank, n < m."""
    reflected: Array = np.array(matrix, dtype=np.float64, order="C")
    rows, columns = reflected.shape
    out: Array = np.empty((rows, rows - columns))
    if AVAILABLE:
        _arithmetic.complement(rows, columns, reflected, out)
    else:
        reference.complement(reflected, out)
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


def root_of_squares(*parts: Any) -> Any:
    """√(a² + b² + …), of numbers or arrays: independent deviations together."""
    square: Any = 0.0
    for part in parts:
        square = square + part * part
    return np.sqrt(square)
