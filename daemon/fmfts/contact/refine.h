/* The table of a pad's response, and the press that most likely caused a change of pose. response.py explains both. Plain C, no
 * allocation, no globals. */
#ifndef FMFTS_REFINE_H
#define FMFTS_REFINE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    FMFTS_MOVED = 5, /* a, b, c in mm, m, n */
    FMFTS_MAX_LOADS = 3,
    FMFTS_MAX_PRESS = 2 + FMFTS_MAX_LOADS, /* x, y in mm, loads in N */
    FMFTS_MAX_MONOMIALS = 16,
    FMFTS_MAX_EXPONENT = 9,
};

/* coefficient: (knots[0] + 2) × (knots[1] + 2) × monomials × FMFTS_MOVED; exponent: monomials × loads, each at most
 * FMFTS_MAX_EXPONENT. */
typedef struct {
    size_t knots[2], monomials, loads, most_exponent;
    double first_mm[2], spacing_mm[2], scale_n;
    const int32_t *exponent;
    const double *coefficient;
} fmfts_response;

/* Where the table ends along an axis; it begins at first_mm. */
static inline double fmfts_last_mm(const fmfts_response *response, int axis)
{
    return response->first_mm[axis] + response->spacing_mm[axis] * (double)(response->knots[axis] - 1);
}

/* content: knots, monomials, loads, first_mm, spacing_mm, scale_n and the coefficients as doubles, then the exponents as
 * int32. False if it is not a response, a spacing or scale is not positive, or it is larger than the limits above. */
bool fmfts_view_response(const void *content, size_t size, fmfts_response *response);

/* The change of pose under `press`, and its derivative by the press. */
void fmfts_respond(const fmfts_response *response, const double *press, double change[FMFTS_MOVED],
                   double slope[FMFTS_MOVED][FMFTS_MAX_PRESS]);

/* The change of pose alone. */
void fmfts_move(const fmfts_response *response, const double *press, double change[FMFTS_MOVED]);

/* The factor of each coefficient, without the five numbers of a change: the change is linear in the coefficients. */
void fmfts_basis(const fmfts_response *response, const double *press, double *basis);

/* The search for the press behind a change of pose. covariance: of the change, 5 × 5. steps: the largest number of
 * trials of Levenberg–Marquardt; settled: the search ends with a step shorter than this, in deviations of each unknown
 * alone. shear_share: a prior on each of a press's two shears, whose deviation is this share of the force; 0: no
 * prior. holds_force: the force keeps its first value, if there is a prior. */
typedef struct {
    const double *change, *covariance;
    int steps;
    double settled, shear_share;
    bool holds_force;
} fmfts_press_search;

/* Moves `press` to the most likely one. spread: receives its covariance, (2 + loads)², of the others if the force is
 * held. chi2: of the residual of the change, and of the shear against the prior. False, and nothing is written, if
 * `covariance` is not positive definite. */
bool fmfts_refine(const fmfts_response *response, const fmfts_press_search *search, double *press, double *spread, double *chi2);

/* The inverse of the covariance of a change, 5 × 5. False if that is not positive definite. */
bool fmfts_information(const double *covariance, double information[FMFTS_MOVED][FMFTS_MOVED]);

/* A press with shear. press: where the search begins; receives the most likely press. gain: its derivative by the
 * change of pose. bend: the factor of each variance because other presses are about as likely. */
typedef struct {
    double press[FMFTS_MAX_PRESS], variance[FMFTS_MAX_PRESS], bend[FMFTS_MAX_PRESS], gain[FMFTS_MAX_PRESS][FMFTS_MOVED];
} fmfts_sheared;

/* sheared.c: finds it. looks: for other presses that are about as likely; else each bend is 1. False if the covariance
 * is not positive definite, or the response is to normal forces alone. */
bool fmfts_solve_shear(const fmfts_response *response, const fmfts_press_search *search, bool looks, fmfts_sheared *found);

/* elsewhere.c: continues from a press without shear that fmfts_refine found. wider [3]: the factor of each variance
 * because other presses explain the change about as well; not written without a press. */
void fmfts_look_elsewhere(const fmfts_response *response, const double change[FMFTS_MOVED], const double *covariance,
                          double *press, double *spread, double *wider);

#endif
