/* Dense algebra of small matrices, row by row, in one order of every sum: matrix.py, which explains it. */
#ifndef FMFTS_MATRIX_H
#define FMFTS_MATRIX_H

#include <stdbool.h>
#include <stddef.h>

/* out [m][n] = a [m][k] · b [k][n] */
void fmfts_product(size_t m, size_t k, size_t n, const double *a, const double *b, double *out);

/* a [n][n] becomes its lower triangle L with a = L·Lᵀ. False where a is not positive definite. */
bool fmfts_cholesky(size_t n, double *a);

/* x [n][columns] becomes L⁻¹·x, and L⁻ᵀ·x; l [n][n]: a lower triangle. */
void fmfts_solve_lower(size_t n, size_t columns, const double *l, double *x);
void fmfts_solve_lower_transposed(size_t n, size_t columns, const double *l, double *x);

/* a [m][n] becomes U·S, v [n][n] = V with a = U·S·Vᵀ. False where the rotations do not come to an end. */
bool fmfts_rotate_columns(size_t m, size_t n, double *a, double *v);

/* complement [m][m − n]: orthonormal, and orthogonal to the columns of a [m][n], n < m, which is destroyed. scale [n]. */
void fmfts_complement(size_t m, size_t n, double *a, double *scale, double *complement);

#endif
