/* Place, force and shear of a press together: five numbers from the five of a change of pose.
 *
 * With the response h, the slope S of it, the change z and its information Ω, and a share σ of the force F, the most likely press p is
 * where
 *
 *     (z − h(p))ᵀ Ω (z − h(p)) + |shear|² / (σF)²
 *
 * is least, and P = (SᵀΩS + prior)⁻¹ its covariance. Friction bounds shear, so σ is its prior: a shear that is even over the cone's disc has
 * half of friction times force as deviation, along each axis. In the middle of the pad the pose tells all five. Toward the rim, and of a light
 * touch, it tells shear less and less; there the answer is the one without shear, and P counts what shear may do to it.
 *
 * P holds where the response is straight over its deviations. It is not where shear and force explain each other: a shear outwards on
 * the rim looks like less force. So P is computed again with the mean of the slopes at the answer and at the press with a force that is
 * REACH deviations larger, which is the slope of the chord (trapezium rule), and with the mean of the priors there. The largest counts. */
#include <math.h>
#include <string.h>

#include "../arithmetic/descent.h"
#include "refine.h"

enum { N = FMFTS_MAX_PRESS, FORCE = 2, SHEAR = 3, CHORDS = 2 };

static const double REACH = 3.0;
/* If the force's deviation is a smaller share of it, the bend makes no deviation larger by more than a twentieth. */
static const double STRAIGHT_SHARE = 0.02;
static const double UNKNOWN = 1e-6; /* a prior deviation of 1 m, as in refine.c */

typedef struct {
    const fmfts_response *response;
    const fmfts_search *search;
    double information[FMFTS_MOVED][FMFTS_MOVED];
} cause;

/* spread = P with the mean of the slopes `a` and `b`; gain: P Sᵀ Ω, or NULL. */
static bool spread_of(const cause *cause, double a[FMFTS_MOVED][N], double b[FMFTS_MOVED][N], double force_n,
                      double spread[N * N], double gain[N][FMFTS_MOVED])
{
    double by_slope[N][FMFTS_MOVED] = {{0.0}}, normal[N * N], room[2 * N * N];
    double of_shear = fmfts_shear_information(cause->search, force_n);
    for (int i = 0; i < N; i++) {
        for (int k = 0; k < FMFTS_MOVED; k++) {
            double slope = 0.5 * (a[k][i] + b[k][i]);
            for (int d = 0; d < FMFTS_MOVED; d++) {
                by_slope[i][d] += slope * cause->information[k][d];
            }
        }
        for (int j = 0; j <= i; j++) {
            double sum = i != j ? 0.0 : i < SHEAR ? UNKNOWN : UNKNOWN + of_shear;
            for (int d = 0; d < FMFTS_MOVED; d++) {
                sum += by_slope[i][d] * 0.5 * (a[d][j] + b[d][j]);
            }
            normal[N * i + j] = normal[N * j + i] = sum;
        }
    }
    if (!fmfts_spread_of(N, NULL, normal, spread, room)) {
        return false;
    }
    for (int i = 0; gain && i < N; i++) {
        for (int d = 0; d < FMFTS_MOVED; d++) {
            gain[i][d] = 0.0;
            for (int j = 0; j < N; j++) {
                gain[i][d] += spread[N * i + j] * by_slope[j][d];
            }
        }
    }
    return true;
}

/* The factor of each variance because the response bends over them. spread: of the press, with its slope. */
static void count_bend(const cause *cause, double slope[FMFTS_MOVED][N], double spread[N * N], fmfts_sheared *found)
{
    const double *press = found->press;
    double there[FMFTS_MOVED][N], farther[N], unused[FMFTS_MOVED], bent[N * N];
    memcpy(bent, spread, sizeof bent);
    for (int chord = 0; chord < CHORDS; chord++) {
        double deviation_n = sqrt(bent[(N + 1) * FORCE]);
        if (!(deviation_n > STRAIGHT_SHARE * press[FORCE])) {
            return;
        }
        for (int i = 0; i < N; i++) {
            farther[i] = press[i] + REACH * bent[N * i + FORCE] / deviation_n;
        }
        fmfts_respond(cause->response, farther, unused, there); /* beyond the table as on its edge */
        if (!spread_of(cause, slope, there, 0.5 * (press[FORCE] + farther[FORCE]), bent, NULL)) {
            return;
        }
        for (int i = 0; i < N; i++) {
            found->bend[i] = fmax(found->bend[i], bent[(N + 1) * i] / found->variance[i]);
        }
    }
}

bool fmfts_solve_shear(const fmfts_response *response, const fmfts_search *search, fmfts_sheared *found)
{
    cause cause = {.response = response, .search = search};
    double spread[N * N], slope[FMFTS_MOVED][N], unused[FMFTS_MOVED], chi2;
    if (response->loads != FMFTS_MAX_LOADS || !fmfts_information(search->covariance, cause.information) ||
        !fmfts_refine(response, search, found->press, spread, &chi2)) {
        return false;
    }
    fmfts_respond(response, found->press, unused, slope);
    if (!spread_of(&cause, slope, slope, found->press[FORCE], spread, found->gain)) {
        return false;
    }
    for (int i = 0; i < N; i++) {
        found->variance[i] = spread[(N + 1) * i];
        found->bend[i] = 1.0;
    }
    count_bend(&cause, slope, spread, found);
    return true;
}
