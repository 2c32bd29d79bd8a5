/* Internal to the solver: what solver.c shares with prepare.c, linearise.c, projection.c and conclude.c. */
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
    fmfts_matrix information; /* the prior's, over `order` */
    fmfts_sources sources;
} fmfts_pose_search;

/* The problem linearised at one state: A over `order` in the upper triangle, g in the next column, χ² in the corner. */
typedef struct {
    fmfts_matrix a;
    double raw_square;
} fmfts_linear;

/* A search in progress. here: linearised at the current state. there: room for the next one. */
typedef struct {
    fmfts_linear *here;
    fmfts_linear *there;
    fmfts_matrix *work;
    double chi2;
    int iterations;
    bool converged;
    bool factored; /* `work` holds the undamped factors of `here` */
} fmfts_pose_descent;

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

/* prepare.c: whether start, parts and settings are valid. */
bool fmfts_valid(const fmfts_problem *problem);

/* prepare.c: the measurements that have a value, in units of their deviations. False if one is invalid. */
bool fmfts_prepare_rows(fmfts_pose_search *search, fmfts_row *rows);

/* prepare.c: the order of columns, and Ω over it. False if the prior is missing or its covariance has no inverse. */
bool fmfts_prepare_columns(fmfts_pose_search *search, fmfts_matrix work);

/* linearise.c: χ² at `state`; infinite if a magnet is in a sensor, or an axis 90° or more from the prior's. */
double fmfts_linearise(fmfts_pose_search *search, const double *state, fmfts_linear *out);

/* conclude.c: covariance and χ², or, if the state is unobservable, the direction. */
fmfts_status fmfts_conclude(fmfts_pose_search *search, fmfts_pose_descent *d, const double *state, double *covariance,
                            double *direction);

/* projection.c: gives `state` the axis that fits best at its position and, if they are estimated, the best moment and
 * ambient field. False, and `state` is unchanged, if the measurements do not determine the moment. */
bool fmfts_best_linear_parts(fmfts_pose_search *search, double *state);

#endif
