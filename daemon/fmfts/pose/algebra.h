/* Small symmetric matrices, upper triangles only. In hot loops these functions are inlined with constant sizes. */
#ifndef FMFTS_ALGEBRA_H
#define FMFTS_ALGEBRA_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "problem.h"

/* The largest step and one column for the right-hand side, rounded up to an even number: rows are aligned for vectors. */
#define FMFTS_STRIDE (FMFTS_MAX_COLUMNS + 2)
/* A column is unobservable if the others explain all but this share of its variance: the rest is rounding. */
#define FMFTS_SINGULAR 1e-11
#define FMFTS_INLINE static inline __attribute__((always_inline))

typedef double fmfts_matrix[FMFTS_STRIDE][FMFTS_STRIDE];

/* factored: A + damping·diag(A) = UᵀDU, with unit U above the diagonal and 1/D on it. False if it is singular.
 * stride: the columns of both; a constant, as everywhere here. */
FMFTS_INLINE bool factor_of_stride(size_t stride, size_t n, double (*a)[stride], double damping, double (*factored)[stride])
{
    for (size_t i = 0; i < n; i++) {
        for (size_t j = i; j < n; j++) {
            factored[i][j] = a[i][j];
        }
        factored[i][i] += damping * a[i][i];
    }
    for (size_t k = 0; k < n; k++) {
        double pivot = factored[k][k], whole = (1.0 + damping) * a[k][k];
        if (!(pivot > 0.0 && pivot >= FMFTS_SINGULAR * whole && pivot < INFINITY)) {
            return false;
        }
        double inverse = 1.0 / pivot;
        factored[k][k] = inverse;
        for (size_t i = k + 1; i < n; i++) {
            double share = factored[k][i] * inverse;
            for (size_t j = i; j < n; j++) {
                factored[i][j] -= share * factored[k][j];
            }
        }
        for (size_t i = k + 1; i < n; i++) {
            factored[k][i] *= inverse;
        }
    }
    return true;
}

FMFTS_INLINE bool factor(size_t n, fmfts_matrix a, double damping, fmfts_matrix factored)
{
    return factor_of_stride(FMFTS_STRIDE, n, a, damping, factored);
}

FMFTS_INLINE void solve_factored_of_stride(size_t stride, size_t n, double (*factored)[stride], double *x)
{
    for (size_t k = 0; k < n; k++) {
        for (size_t j = k + 1; j < n; j++) {
            x[j] -= factored[k][j] * x[k];
        }
    }
    for (size_t k = n; k-- > 0;) {
        x[k] *= factored[k][k];
        for (size_t j = k + 1; j < n; j++) {
            x[k] -= factored[k][j] * x[j];
        }
    }
}

FMFTS_INLINE void solve_factored(size_t n, fmfts_matrix factored, double *x)
{
    solve_factored_of_stride(FMFTS_STRIDE, n, factored, x);
}

/* inverse (full, symmetric) = V D⁻¹ Vᵀ with V = U⁻¹. The factored matrix becomes V. */
FMFTS_INLINE void invert_factored(size_t n, fmfts_matrix factored, fmfts_matrix inverse)
{
    for (size_t i = n; i-- > 0;) {
        double row[FMFTS_STRIDE];
        for (size_t j = i + 1; j < n; j++) {
            row[j] = -factored[i][j];
        }
        for (size_t k = i + 1; k < n; k++) {
            for (size_t j = k + 1; j < n; j++) {
                row[j] -= factored[i][k] * factored[k][j];
            }
        }
        for (size_t j = i + 1; j < n; j++) {
            factored[i][j] = row[j];
        }
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = i; j < n; j++) {
            double sum = (i == j ? 1.0 : factored[i][j]) * factored[j][j];
            for (size_t k = j + 1; k < n; k++) {
                sum += factored[i][k] * factored[k][k] * factored[j][k];
            }
            inverse[i][j] = inverse[j][i] = sum;
        }
    }
}

/* direction: the eigenvector with the smallest eigenvalue of A, scaled to a unit diagonal; by inverse iteration. */
static inline void weakest(size_t n, fmfts_matrix a, fmfts_matrix scaled, fmfts_matrix factored, double *direction)
{
    const double regular = 1e-9; /* makes a singular matrix solvable, and shifts all eigenvalues equally */
    for (size_t i = 0; i < n; i++) {
        for (size_t j = i; j < n; j++) {
            double square = a[i][i] * a[j][j];
            scaled[i][j] = i == j ? (a[i][i] > 0.0 ? 1.0 : 1e-300) : (square > 0.0 ? a[i][j] / sqrt(square) : 0.0);
            scaled[i][j] += i == j ? regular : 0.0;
        }
        direction[i] = 1.0 + 0.1 * (double)i;
    }
    if (!factor(n, scaled, 0.0, factored)) {
        return;
    }
    for (int iteration = 0; iteration < 50; iteration++) {
        solve_factored(n, factored, direction);
        double square = 0.0;
        for (size_t i = 0; i < n; i++) {
            square += direction[i] * direction[i];
        }
        for (size_t i = 0; i < n; i++) {
            direction[i] /= sqrt(square);
        }
    }
}

#endif
