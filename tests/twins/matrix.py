"""Triangles, rotations and reflections of small matrices, each sum added term by term in the order of the textbook.

G. H. Golub, C. F. Van Loan, "Matrix Computations": outer-product Cholesky (4.2), column-oriented substitution (3.1),
one-sided Jacobi (8.6), Householder (5.1). An order that changes, or a fused multiply-add, changes the last bit.
No independent witness of the values, because the daemon once used it: test_arithmetic.py has NumPy's linear algebra for
that.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_SWEEPS = 60
ORTHOGONAL, ROUNDING = 1e-15, 2.0**-52


def product(a: Array, b: Array) -> Array:
    """a (…, m, k) · b (…, k, n)."""
    out: Array = np.zeros((*np.broadcast_shapes(a.shape[:-2], b.shape[:-2]), a.shape[-2], b.shape[-1]))
    for k in range(a.shape[-1]):
        out += a[..., :, k, None] * b[..., None, k, :]
    return out


def cholesky(a: Array) -> bool:
    """Overwrites a (n, n) with its lower triangle L, L·Lᵀ = a; returns False where a is not positive definite."""
    for j in range(len(a)):
        for k in range(j):
            a[j:, j] -= a[j:, k] * a[j, k]
        pivot = float(a[j, j])
        if not 0.0 < pivot < math.inf:
            return False
        a[j, j] = math.sqrt(pivot)
        a[j + 1 :, j] /= a[j, j]
        a[j, j + 1 :] = 0.0
    return True


def solve_lower(lower: Array, x: Array) -> None:
    """Overwrites x (n, columns) with L⁻¹x."""
    for k in range(len(lower)):
        x[k] /= lower[k, k]
        x[k + 1 :] -= lower[k + 1 :, k, None] * x[k]


def solve_lower_transposed(lower: Array, x: Array) -> None:
    """Overwrites x (n, columns) with L⁻ᵀx."""
    for k in reversed(range(len(lower))):
        x[k] /= lower[k, k]
        x[:k] -= lower[k, :k, None] * x[k]


def rotate_columns(a: Array, v: Array) -> bool:
    """Overwrites a (m, n) with U·S, and v (n, n) with V; returns False where the rotations do not converge."""
    size = a.shape[1]
    v[:] = np.eye(size)
    # A column with a smaller square is only the rounding of other columns: rotating it would never converge.
    least = ROUNDING * max(a.shape)
    floor = least * least * _along(a.ravel(), a.ravel())
    for _ in range(MOST_SWEEPS):
        rotated = False
        for p in range(size - 1):
            for q in range(p + 1, size):
                common = _along(a[:, p], a[:, q])
                first, second = _along(a[:, p], a[:, p]), _along(a[:, q], a[:, q])
                rounding = first <= floor or second <= floor
                if rounding or not abs(common) > ORTHOGONAL * math.sqrt(first) * math.sqrt(second):
                    continue
                zeta = (second - first) / (2.0 * common)
                tangent = (1.0 if zeta >= 0.0 else -1.0) / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
                cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
                for matrix in (a, v):
                    _rotate(matrix, p, q, cosine, cosine * tangent)
                rotated = True
        if not rotated:
            return True
    return False


def complement(a: Array, out: Array) -> None:
    """Fills out (m, m − n) with orthonormal columns orthogonal to a (m, n), by Householder reflections. Destroys a."""
    rows, columns = a.shape
    scale = []
    for k in range(columns):
        length = math.sqrt(_along(a[k:, k], a[k:, k]))
        a[k, k] += length if a[k, k] >= 0.0 else -length
        square = _along(a[k:, k], a[k:, k])
        scale.append(2.0 / square if square > 0.0 else 0.0)
        for j in range(k + 1, columns):
            _reflect(a[k:, k], scale[k], a[k:, j])
    out[:] = np.eye(rows)[:, columns:]
    for k in reversed(range(columns)):
        for j in range(rows - columns):
            _reflect(a[k:, k], scale[k], out[k:, j])


def _along(a: Array, b: Array) -> float:
    total = 0.0
    for term in (a * b).tolist():
        total += term  # not sum(), which is more exact from Python 3.12 on
    return total


def _rotate(matrix: Array, p: int, q: int, cosine: float, sine: float) -> None:
    one, other = matrix[:, p].copy(), matrix[:, q].copy()
    matrix[:, p] = cosine * one - sine * other
    matrix[:, q] = sine * one + cosine * other


def _reflect(v: Array, scale: float, column: Array) -> None:
    column -= (_along(v, column) * scale) * v
