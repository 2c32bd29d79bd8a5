#include "descent.h"

#include <math.h>
#include <string.h>

#include "matrix.h"

bool fmfts_finite(size_t count, const double *values)
{
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(values[i])) {
            return false;
        }
    }
    return true;
}

/* NaN is the lowest. */
double fmfts_within(double value, double lowest, double highest)
{
    return !(value >= lowest) ? lowest : value > highest ? highest : value;
}

/* Overwrites `step`, the right-hand side, with the solution of the damped normal equations. */
static fmfts_descent_end solve(const fmfts_descent *search, double damping, const double *normal, double *root, double *step)
{
    size_t n = search->unknowns;
    memcpy(root, normal, n * n * sizeof(double));
    for (size_t i = 0; i < n; i++) {
        root[i * n + i] += damping * normal[i * n + i] + (search->floor ? search->floor[i] : 0.0);
    }
    if (!fmfts_finite(n * n, root)) {
        return FMFTS_NO_NUMBER;
    }
    if (!fmfts_cholesky(n, root)) {
        return FMFTS_NO_STEP;
    }
    fmfts_solve_lower(n, 1, root, step);
    fmfts_solve_lower_transposed(n, 1, root, step);
    return fmfts_finite(n, step) ? FMFTS_DESCENDED : FMFTS_NO_NUMBER;
}

double fmfts_step_length(size_t n, const double *from, const double *to, const double *normal)
{
    double longest = 0.0;
    for (size_t i = 0; i < n; i++) {
        double moved = fabs((to[i] - from[i]) * sqrt(normal[i * n + i]));
        longest = moved > longest ? moved : longest;
    }
    return longest;
}

fmfts_descent_end fmfts_descend(const fmfts_descent *search, double *at, double *chi2, double *room)
{
    size_t n = search->unknowns;
    double *normal = room, *root = normal + n * n, *right = root + n * n, *step = right + n, *trial = step + n;
    double damping = search->damping;
    if (!search->take(search->problem, at, chi2, normal, right)) {
        return FMFTS_NOT_TAKEN;
    }
    for (size_t i = 0; n && i < search->iterations; i++) {
        memcpy(step, right, n * sizeof(double));
        fmfts_descent_end end = solve(search, damping, normal, root, step);
        if (end != FMFTS_DESCENDED) {
            return end;
        }
        if (search->shorten) {
            search->shorten(search->problem, step);
        }
        for (size_t k = 0; k < n; k++) {
            step[k] += at[k];
            trial[k] = fmfts_within(step[k], search->lowest[k], search->highest[k]);
        }
        if (!(search->judge(search->problem, trial) <= *chi2 * (1.0 + search->rounding))) {
            /* A step that the limits cut short says nothing about how near the minimum is. */
            bool is_settled = fmfts_step_length(n, at, step, normal) < search->settled;
            damping *= search->damping_factor;
            if (damping > search->most_damping || is_settled) {
                break;
            }
            continue;
        }
        double length = fmfts_step_length(n, at, trial, normal);
        memcpy(at, trial, n * sizeof(double));
        damping /= search->damping_factor;
        if (!search->take(search->problem, at, chi2, normal, right)) {
            return FMFTS_NOT_TAKEN;
        }
        if (length < search->settled) {
            break;
        }
    }
    return FMFTS_DESCENDED;
}

bool fmfts_spread_of(size_t n, const double *floor, double *normal, double *covariance, double *room)
{
    double *half = room, *across = half + n * n;
    for (size_t i = 0; i < n; i++) {
        normal[i * n + i] += floor ? floor[i] : 0.0;
        for (size_t j = 0; j < n; j++) {
            half[i * n + j] = i == j ? 1.0 : 0.0;
        }
    }
    if (!fmfts_finite(n * n, normal) || !fmfts_cholesky(n, normal)) {
        return false;
    }
    fmfts_solve_lower(n, n, normal, half);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            across[i * n + j] = half[j * n + i];
        }
    }
    fmfts_product(n, n, n, across, half, covariance);
    return true;
}
