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
    size_t knots[2], monomials, loads;
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

/* A change of pose [FMFTS_MOVED], and its covariance [FMFTS_MOVED]². */
typedef struct {
    const double *change, *covariance;
} fmfts_movement;

/* Moves `press` by `steps` trials of Levenberg–Marquardt. spread: receives the covariance of the press, (2 + loads)². chi2: of
 * what it leaves of the change. False, and nothing is written, if the covariance is not positive definite. */
bool fmfts_refine(const fmfts_response *response, fmfts_movement movement, int steps, double *press, double *spread,
                  double *chi2);

/* elsewhere.c: continues from a press without shear that fmfts_refine found. wider [3]: the factor of each variance
 * because other presses explain the change about as well; not written without a press. */
void fmfts_look_elsewhere(const fmfts_response *response, const double change[FMFTS_MOVED], const double *covariance,
                          double *press, double *spread, double *wider);

#endif
