/* Whether a press can move the magnet as it moved. Steel or a magnet near the pad shifts and tilts the estimate by many
 * deviations, upwards as often as downwards, and the model gives a force for most such poses. With χ² of the change
 * from rest, and χ² that the best press leaves, a press explains
 *
 *     1 - χ²(left) / χ²(change)
 *
 * A share is used because the deviations may be too small for a finger of another shape, for shear, or for other
 * silicone. */
#include <math.h>

#include "step.h"

enum { STEPS = 8 };

static double left_chi2(const fmfts_response *table, const double change[FMFTS_MOVED], const double *covariance, const double *press)
{
    double left[FMFTS_MOVED], chi2;
    fmfts_move(table, press, left);
    for (int i = 0; i < FMFTS_MOVED; i++) {
        left[i] = change[i] - left[i];
    }
    return fmfts_chi2_from_rest(FMFTS_MOVED, left, covariance, &chi2) ? chi2 : INFINITY;
}

double fmfts_explained_share(const fmfts_response *table, const fmfts_press_search *search, const double *answer, double enough,
                             double *lowered_chi2)
{
    const double *change = search->change, *covariance = search->covariance;
    fmfts_press_search longer = *search;
    double press[FMFTS_MAX_PRESS], spread[FMFTS_MAX_PRESS * FMFTS_MAX_PRESS], whole, chi2;
    *lowered_chi2 = 0.0;
    if (!fmfts_chi2_from_rest(FMFTS_MOVED, change, covariance, &whole) || !(whole > 0.0)) {
        return 1.0;
    }
    double left = left_chi2(table, change, covariance, answer);
    for (size_t i = 0; i < 2 + table->loads; i++) {
        press[i] = answer[i];
    }
    longer.steps = STEPS;
    if (left > (1.0 - enough) * whole && fmfts_refine(table, &longer, press, spread, &chi2)) {
        left = fmin(left, chi2);
    }
    *lowered_chi2 = whole - left;
    return 1.0 - left / whole;
}
