/* Where the fingers are when one of them is put elsewhere: valley.py explains it. */
#include "fit.h"

#include <math.h>

#include "../arithmetic/matrix.h"

/* Keeps number `i` of the fingers on the table, and a force at least as large as what still presses. */
static double on_the_table(const fmfts_search *search, double least_force_n, size_t i, double value)
{
    size_t axis = i % FMFTS_FINGER;
    double lowest = axis < 2 ? search->head->lowest[axis] : least_force_n;
    double raised = lowest > value ? lowest : value;
    return axis < 2 && search->head->highest[axis] < raised ? search->head->highest[axis] : raised;
}

static double sum_of_products(size_t n, const double *a, const double *b)
{
    double sum = 0.0;
    fmfts_product(1, n, 1, a, b, &sum);
    return sum;
}

/* One step of Gauss-Newton that leaves `finger` where it is along `direction`. False where it leads nowhere. */
static bool step_across(const fmfts_search *search, double least_force_n, size_t n, const double *direction,
                        const fmfts_several_work *work, double *finger)
{
    double right[FMFTS_SEVERAL_UNKNOWNS], spread[FMFTS_SEVERAL_UNKNOWNS * FMFTS_SEVERAL_UNKNOWNS];
    double step[FMFTS_SEVERAL_UNKNOWNS], along[FMFTS_SEVERAL_UNKNOWNS];
    if (!fmfts_spread(search, n, work, right, spread)) {
        return false;
    }
    fmfts_product(n, n, 1, spread, right, step);
    fmfts_product(n, n, 1, spread, direction, along);
    double across = sum_of_products(n, direction, along);
    if (!(across > 0.0)) {
        return false;
    }
    double share = sum_of_products(n, direction, step) / across;
    for (size_t i = 0; i < n; i++) {
        finger[i] = on_the_table(search, least_force_n, i, finger[i] + (step[i] - along[i] * share));
    }
    return fmfts_finite(n, finger);
}

/* Moves `finger` to the minimum across `direction`. Returns its chi-square, infinite where there is none. */
static double fitted_across(const fmfts_several *model, const fmfts_search *search, const fmfts_valley_limits *limits,
                            size_t fingers, const double *direction, const fmfts_measured *measured,
                            fmfts_several_work *work, double *finger)
{
    size_t unknowns = FMFTS_FINGER * fingers;
    fmfts_predicted *predicted = &work->predicted[0];
    for (double step = 0.0; step < limits->steps; step += 1.0) {
        fmfts_predict(model, fingers, finger, predicted);
        fmfts_whiten(work, work->root, measured, predicted->field, work->white);
        fmfts_whiten_slope(predicted->slope, unknowns, work, work->slope);
        if (!step_across(search, limits->least_force_n, unknowns, direction, work, finger)) {
            return INFINITY;
        }
    }
    fmfts_predict(model, fingers, finger, predicted);
    return fmfts_whiten(work, work->root, measured, predicted->field, work->white);
}

fmfts_refusal fmfts_valley(const fmfts_several *model, const fmfts_search *search, const fmfts_valley_limits *limits,
                           size_t fingers, const double *finger, size_t ways, const double *away, const double *direction,
                           const fmfts_measured *measured, const double *ambient_t, fmfts_several_work *work, double *there,
                           double *chi2)
{
    size_t unknowns = FMFTS_FINGER * fingers;
    fmfts_refusal refusal = fmfts_whitener(model, fingers, finger, measured, ambient_t, work);
    if (refusal.kind != FMFTS_FINE) {
        return refusal;
    }
    if (!fmfts_finite(ways * unknowns, away) || !fmfts_finite(ways * unknowns, direction)) {
        return (fmfts_refusal){FMFTS_NOT_FINITE, 0};
    }
    for (size_t side = 0; side < 2 * ways; side++) {
        const double *step = away + side / 2 * unknowns;
        double *moved = there + side * unknowns;
        for (size_t i = 0; i < unknowns; i++) {
            moved[i] = on_the_table(search, limits->least_force_n, i, side % 2 ? finger[i] - step[i] : finger[i] + step[i]);
        }
        chi2[side] = fitted_across(model, search, limits, fingers, direction + side / 2 * unknowns, measured, work, moved);
    }
    return refusal;
}
