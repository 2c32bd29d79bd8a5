/* Algebra of small dense matrices, stored by rows, with one order of every sum. matrix.py explains why. */
#ifndef FMFTS_MATRIX_H
#define FMFTS_MATRIX_H

#include <stdbool.h>
#include <stddef.h>

/* out [m][n] = a [m][k] · b [k][n] */
void fmfts_product(size_t m, size_t k, size_t n, const double *a, const double *b, double *out);

/* Overwrites a [n][n] with its lower triangle L, a = L·Lᵀ. Returns false where a is not positive definite. */
bool fmfts_cholesky(size_t n, double *a);

/* Overwrites x [n][columns] with L⁻¹·x, or with L⁻ᵀ·x; l [n][n] is a lower triangle. */
void fmfts_solve_lower(size_t n, size_t columns, const double *l, double *x);
void fmfts_solve_lower_transposed(size_t n, size_t columns, const double *l, double *x);

/* Overwrites a [m][n] = U·S·Vᵀ with U·S, and v [n][n] with V. Returns false where the rotations do not converge. */
bool fmfts_rotate_columns(size_t m, size_t n, double *a, double *v);

/* Fills complement [m][m − n] with orthonormal columns orthogonal to a [m][n], n < m. Destroys a; scale [n] is scratch. */
void fmfts_complement(size_t m, size_t n, double *a, double *scale, double *complement);

#endif
