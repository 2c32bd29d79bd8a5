/* What a solve knows besides its state: shared by solver.c and projection.c, no part of the interface. */
#ifndef FMFTS_SEARCH_H
#define FMFTS_SEARCH_H

#include "model.h"

typedef struct {
    const fmfts_problem *problem;
    size_t columns;
    const fmfts_row *rows;
    size_t row_count;
    size_t order[FMFTS_MAX_COLUMNS]; /* the active columns, then the considered ones */
    size_t active;
    size_t ordered;
    bool has_prior;
    bool with_gradient;
    fmfts_matrix information; /* the prior's, over `order` */
    fmfts_sources sources;
} fmfts_search;

/* The problem about one state: A in the upper triangle over `order`, g in the column after it, χ² in the corner. */
typedef struct {
    fmfts_matrix a;
    double raw_square;
} fmfts_linear;

/* A search under way: where it stands, and room for where it tries to go. */
typedef struct {
    fmfts_linear *here;
    fmfts_linear *there;
    fmfts_matrix *work;
    double chi2;
    int iterations;
    bool converged;
    bool factored; /* `work` holds the undamped factors of where it stands */
} fmfts_descent;

FMFTS_INLINE void fmfts_fill(double *values, size_t count, double value)
{
    for (size_t i = 0; i < count; i++) {
        values[i] = value;
    }
}

FMFTS_INLINE bool fmfts_estimated(uint8_t part)
{
    return part == FMFTS_FREE || part == FMFTS_PRIOR;
}

/* prepare.c: whether start, parts and settings are what they claim to be. */
bool fmfts_valid(const fmfts_problem *problem);

/* prepare.c: the measurements that hold a value, in units of their deviations. False where one is not a measurement. */
bool fmfts_prepare_rows(fmfts_search *search, fmfts_row *rows);

/* prepare.c: the order of columns, and Ω over it. False where the prior is missing or not one. */
bool fmfts_prepare_columns(fmfts_search *search, fmfts_matrix work);

/* linearise.c: χ² about `state`, infinite where it is not one: a magnet in a sensor, an axis over 90° from the prior's. */
double fmfts_linearise(fmfts_search *search, const double *state, fmfts_linear *out);

/* conclude.c: covariance and χ² where there are any, else the direction that has none. */
fmfts_status fmfts_conclude(fmfts_search *search, fmfts_descent *d, const double *state, double *covariance,
                            double *direction);

/* projection.c: gives `state` the axis and, where they are estimated, moment and ambient that fit best at its position.
 * False, and `state` as it was, where the measurements leave the moment open. */
bool fmfts_best_linear_parts(fmfts_search *search, double *state);

#endif
