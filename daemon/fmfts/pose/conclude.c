/* The end of a search: the covariance, or the direction that no measurement determines. */
#include "search.h"

/* A deviation above this share of the distance to the nearest sensor, or of a radian, is meaningless: the field falls
 * with the third power of the distance, so the model is not linear over this range, and the covariance is wrong. */
#define UNCERTAIN 0.25

/* Whether a position or an axis is so uncertain that its covariance is meaningless. */
static bool uncertain(const fmfts_pose_search *search, const double *state, fmfts_matrix inverse)
{
    double variance[FMFTS_MAX_COLUMNS] = {0};
    for (size_t i = 0; i < search->active; i++) {
        variance[search->order[i]] = inverse[i][i];
    }
    for (size_t m = 0; m < search->problem->magnet_count; m++) {
        const double *position = state + first_value(m), *own = variance + first_column(m);
        double nearest = INFINITY;
        for (size_t r = 0; r < search->row_count; r++) {
            double away[3];
            for (int i = 0; i < 3; i++) {
                away[i] = search->rows[r].place[i] - position[i];
            }
            nearest = search->rows[r].shares_place != 0.0 ? nearest : fmin(nearest, dot3(away, away));
        }
        double widest = fmax(fmax(own[0], own[1]), own[2]);
        double most_tilted = fmax(own[TILT_COLUMN], own[TILT_COLUMN + 1]);
        if (widest > UNCERTAIN * UNCERTAIN * nearest || most_tilted > UNCERTAIN * UNCERTAIN) {
            return true;
        }
    }
    return false;
}

/* Replaces the inverse of the active columns by the covariance over `order`, and χ² by that at the most probable value of
 * the considered parts. False if there is no such value. */
static bool add_considered(const fmfts_pose_search *search, fmfts_pose_descent *d, fmfts_matrix inverse)
{
    size_t n = search->active, all = search->ordered, rest = all - n;
    fmfts_linear *here = d->here;
    fmfts_matrix *sensitivity = &d->there->a; /* active × considered: minus the estimate's change per unit */
    const double *prior = search->problem->prior_covariance;
    for (size_t i = 0; i < n; i++) {
        for (size_t c = 0; c < rest; c++) {
            double sum = 0.0;
            for (size_t j = 0; j < n; j++) {
                sum += inverse[i][j] * here->a[j][n + c];
            }
            (*sensitivity)[i][c] = sum;
        }
    }
    double slope[FMFTS_STRIDE], solved[FMFTS_STRIDE];
    fmfts_matrix schur;
    for (size_t c = 0; c < rest; c++) {
        slope[c] = here->a[n + c][all];
        for (size_t i = 0; i < n; i++) {
            slope[c] -= (*sensitivity)[i][c] * here->a[i][all];
        }
        solved[c] = slope[c];
        for (size_t e = c; e < rest; e++) {
            schur[c][e] = here->a[n + c][n + e];
            for (size_t i = 0; i < n; i++) {
                schur[c][e] -= here->a[i][n + c] * (*sensitivity)[i][e];
            }
        }
    }
    if (!factor(rest, schur, 0.0, *d->work)) {
        return false;
    }
    solve_factored(rest, *d->work, solved);
    for (size_t c = 0; c < rest; c++) {
        d->chi2 -= slope[c] * solved[c];
        for (size_t e = 0; e < rest; e++) {
            inverse[n + c][n + e] = prior[search->order[n + c] * search->columns + search->order[n + e]];
        }
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t c = 0; c < rest; c++) {
            double sum = 0.0;
            for (size_t e = 0; e < rest; e++) {
                sum -= (*sensitivity)[i][e] * inverse[n + e][n + c];
            }
            inverse[i][n + c] = inverse[n + c][i] = sum;
        }
        for (size_t j = 0; j < n; j++) {
            for (size_t c = 0; c < rest; c++) {
                inverse[i][j] -= inverse[i][n + c] * (*sensitivity)[j][c];
            }
        }
    }
    return true;
}

static bool invert(size_t n, const fmfts_pose_descent *d, fmfts_matrix inverse)
{
    double(*work)[FMFTS_STRIDE] = *d->work;
    bool regular = d->factored || factor(n, d->here->a, 0.0, work);
    if (regular) {
        switch (n) {
        case 5:
            invert_factored(5, work, inverse);
            break;
        case 6:
            invert_factored(6, work, inverse);
            break;
        case 8:
            invert_factored(8, work, inverse);
            break;
        default:
            invert_factored(n, work, inverse);
        }
    }
    return regular;
}

fmfts_status fmfts_conclude(fmfts_pose_search *search, fmfts_pose_descent *d, const double *state, double *covariance,
                             double *direction)
{
    size_t n = search->active;
    fmfts_matrix inverse;
    if (!invert(n, d, inverse) || uncertain(search, state, inverse)) {
        double own[FMFTS_STRIDE];
        if (!direction) {
            return FMFTS_UNOBSERVABLE;
        }
        weakest(n, d->here->a, d->there->a, *d->work, own);
        fmfts_fill(direction, search->columns, 0.0);
        for (size_t i = 0; i < n; i++) {
            direction[search->order[i]] = own[i];
        }
        return FMFTS_UNOBSERVABLE;
    }
    if (search->ordered > n && !add_considered(search, d, inverse)) {
        return FMFTS_INVALID;
    }
    fmfts_fill(covariance, search->columns * search->columns, 0.0);
    for (size_t i = 0; i < search->ordered; i++) {
        for (size_t j = 0; j < search->ordered; j++) {
            covariance[search->order[i] * search->columns + search->order[j]] = inverse[i][j];
        }
    }
    return d->converged ? FMFTS_CONVERGED : FMFTS_AT_LIMIT;
}
