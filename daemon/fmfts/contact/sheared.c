/* Place, force and shear of a press together: five numbers from the five of a change of pose.
 *
 * With the response h, the slope S of it, the change z and its information Ω, and a share σ of the force F, the most likely press p is
 * where
 *
 *     χ² = (z − h(p))ᵀ Ω (z − h(p)) + |shear|² / (σF)²
 *
 * is least, and P = (SᵀΩS + prior)⁻¹ its covariance. Friction bounds shear, so σ is its prior: a shear that is even over the cone's disc has
 * half of friction times force as deviation, along each axis. In the middle of the pad the pose tells all five. Toward the rim, and of a light
 * touch, it tells shear less and less; there the answer is the one without shear, and P counts what shear may do to it.
 *
 * P holds where the response is straight over its deviations. It is not where shear and force explain each other: a shear outwards on
 * the rim looks like a third of the force. χ² then stays low up to the largest force, or has a second minimum. So other forces are
 * tried, each with the most likely place and shear for it. Where that raises χ² by Δ and changes the answer by d, the variance
 * is (d² + s²) / Δ, with the variance s² there: the slope of a chord. The largest counts. */
#include <math.h>
#include <string.h>

#include "refine.h"

enum { N = FMFTS_MAX_PRESS, FORCE = 2, FEWEST_LOOKS = 2, MOST_LOOKS = 8, LOOK_STEPS = 8 };

static const double REACH = 3.0;  /* deviations to the first force that is tried */
static const double GROWTH = 1.5; /* each is so many times as far away as the one before */
/* A force that is less likely than three deviations does not count. With 16, 2 instead of 7 frames of lab/results/shear.md are wrong,
 * and the deviations of usual presses are a quarter too large. */
static const double FAR_CHI2 = 9.0;
static const double LOOK_SETTLED = 0.3; /* deviations: Δ is then known to 0.1 */
/* The answer has at least one deviation. */
static const double LEAST_DELTA = 1.0;
/* Presses are expected up to this multiple of the calibrated force. */
static const double LARGEST_FORCE = 1.5;
/* If the force's deviation is a smaller share of it, no deviation becomes larger by more than a twentieth. */
static const double STRAIGHT_SHARE = 0.02;

/* gain = P Sᵀ Ω */
static void gain_of(const double spread[N * N], double slope[FMFTS_MOVED][N], double information[FMFTS_MOVED][FMFTS_MOVED],
                    double gain[N][FMFTS_MOVED])
{
    for (int i = 0; i < N; i++) {
        double by_change[FMFTS_MOVED] = {0.0};
        for (int k = 0; k < FMFTS_MOVED; k++) {
            for (int j = 0; j < N; j++) {
                by_change[k] += spread[N * i + j] * slope[k][j];
            }
        }
        for (int d = 0; d < FMFTS_MOVED; d++) {
            gain[i][d] = 0.0;
            for (int k = 0; k < FMFTS_MOVED; k++) {
                gain[i][d] += by_change[k] * information[k][d];
            }
        }
    }
}

/* The factor of each variance because of presses with more force. chi2: of the press. */
static void count_others(const fmfts_response *response, const fmfts_press_search *search, const double spread[N * N], double chi2,
                         fmfts_sheared *found)
{
    const double *press = found->press;
    double deviation_n = sqrt(spread[(N + 1) * FORCE]), away_n = REACH * deviation_n;
    double top_n = fmax(LARGEST_FORCE * response->scale_n, press[FORCE] + deviation_n), other[N], there[N * N], chi2_there;
    fmfts_press_search held = *search;
    if (!(deviation_n > STRAIGHT_SHARE * press[FORCE])) {
        return;
    }
    held.steps = LOOK_STEPS;
    held.settled = LOOK_SETTLED;
    held.holds_force = true;
    for (int i = 0; i < N; i++) {
        other[i] = press[i] + spread[N * i + FORCE] / deviation_n;
    }
    for (int look = 0; look < MOST_LOOKS; look++, away_n *= GROWTH) {
        double more_n = fmin(away_n, top_n - press[FORCE]), longer = more_n / (other[FORCE] - press[FORCE]);
        for (int i = 0; i < N; i++) {
            other[i] = press[i] + longer * (other[i] - press[i]);
        }
        if (!fmfts_refine(response, &held, other, there, &chi2_there)) {
            return;
        }
        double delta = fmax(chi2_there - chi2, LEAST_DELTA);
        for (int i = 0; (look == 0 || delta < FAR_CHI2) && i < N; i++) {
            double d = other[i] - press[i], variance = (d * d + there[(N + 1) * i]) / delta;
            found->bend[i] = fmax(found->bend[i], variance / found->variance[i]);
        }
        bool is_far = delta > FAR_CHI2 && look + 1 >= FEWEST_LOOKS; /* a second minimum may be behind the first force */
        if (is_far || !(more_n < top_n - press[FORCE])) {
            return;
        }
    }
}

bool fmfts_solve_shear(const fmfts_response *response, const fmfts_press_search *search, bool looks, fmfts_sheared *found)
{
    double information[FMFTS_MOVED][FMFTS_MOVED], spread[N * N], slope[FMFTS_MOVED][N], unused[FMFTS_MOVED], chi2;
    if (response->loads != FMFTS_MAX_LOADS || !fmfts_information(search->covariance, information) ||
        !fmfts_refine(response, search, found->press, spread, &chi2)) {
        return false;
    }
    fmfts_respond(response, found->press, unused, slope);
    gain_of(spread, slope, information, found->gain);
    for (int i = 0; i < N; i++) {
        found->variance[i] = spread[(N + 1) * i];
        found->bend[i] = 1.0;
    }
    if (looks) {
        count_others(response, search, spread, chi2, found);
    }
    return true;
}
