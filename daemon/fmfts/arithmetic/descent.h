/* Damped least squares (Levenberg–Marquardt) within limits: for any residual with its slope. */
#ifndef FMFTS_DESCENT_H
#define FMFTS_DESCENT_H

#include <stdbool.h>
#include <stddef.h>

/* What is searched. All arrays are [unknowns].
 *
 * iterations: number of trials at most. rounding: a relative increase of χ² up to this is ignored. settled: a search ends at a
 * step that is shorter than this, in the deviation of each unknown alone; a step that raises χ² is measured before the limits
 * cut it. damping: the first; a step that raises χ² multiplies it by damping_factor, a good one divides it; beyond most_damping
 * the search ends. floor: is added to the diagonal of the normal matrix, so that an unknown that no measurement determines
 * stays where it is; NULL: nothing is added. */
typedef struct {
    size_t unknowns, iterations;
    double settled, rounding, damping, damping_factor, most_damping;
    const double *lowest, *highest, *floor;
    void *problem;
    /* χ² of a trial, with the weights of the last accepted point. */
    double (*judge)(void *problem, const double *trial);
    /* Accepts the last trial point, or the start: χ², the normal matrix J'WJ [unknowns][unknowns], and J'Wr, under the
     * weights there. False ends the search. */
    bool (*take)(void *problem, const double *at, double *chi2, double *normal, double *right);
    /* Shortens a step that is too long; NULL: none is. */
    void (*shorten)(void *problem, double *step);
} fmfts_descent;

typedef enum { FMFTS_DESCENDED, FMFTS_NOT_TAKEN, FMFTS_NO_STEP, FMFTS_NO_NUMBER } fmfts_descent_end;

/* The normal matrix, two more of its size, and three rows. */
#define FMFTS_DESCENT_ROOM(unknowns) (3 * (unknowns) * (unknowns) + 3 * (unknowns))

/* Moves `at` to the minimum near it. FMFTS_NO_STEP, FMFTS_NO_NUMBER: a normal matrix, or a step, is not positive definite, or not
 * finite; `at` is then the best so far. room: FMFTS_DESCENT_ROOM doubles; it begins with the normal matrix at `at`. */
fmfts_descent_end fmfts_descend(const fmfts_descent *search, double *at, double *chi2, double *room);

/* covariance [n][n] = normal⁻¹, floor [n] added to its diagonal. False where there is none. normal is destroyed; room [2][n][n]. */
bool fmfts_spread_of(size_t n, const double *floor, double *normal, double *covariance, double *room);

/* The length of a step [n], in the deviation of each unknown alone. */
double fmfts_step_length(size_t n, const double *from, const double *to, const double *normal);

double fmfts_within(double value, double lowest, double highest);

/* Whether all are finite. */
bool fmfts_finite(size_t count, const double *values);

#endif
