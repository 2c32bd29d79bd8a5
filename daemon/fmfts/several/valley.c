/* The fingers when one of them is held elsewhere: valley.py explains it. */
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

/* One step of Gauss-Newton that keeps `finger` along `direction`. False if there is none. */
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

typedef struct {
    const fmfts_several *model;
    const fmfts_search *search;
    const fmfts_measured *measured;
    const fmfts_valley_limits *limits;
    fmfts_several_work *work;
} course;

/* Moves so many fingers, at `finger`, to the minimum across `direction`. Returns its χ², infinite where there is none. */
static double fitted_across(const course *c, size_t fingers, const double *direction, double *finger)
{
    size_t unknowns = FMFTS_FINGER * fingers;
    fmfts_several_work *work = c->work;
    fmfts_predicted *predicted = &work->predicted[0];
    for (double step = 0.0; step < c->limits->steps; step += 1.0) {
        fmfts_predict(c->model, (fmfts_fingers){fingers, finger}, predicted);
        fmfts_whiten(work, work->root, c->measured, predicted->field, work->white);
        fmfts_whiten_slope(predicted->slope, unknowns, work, work->slope);
        if (!step_across(c->search, c->limits->least_force_n, unknowns, direction, work, finger)) {
            return INFINITY;
        }
    }
    fmfts_predict(c->model, (fmfts_fingers){fingers, finger}, predicted);
    return fmfts_whiten(work, work->root, c->measured, predicted->field, work->white);
}

fmfts_refusal fmfts_valley(const fmfts_several *model, const fmfts_search *search, fmfts_fingers fingers,
                           const fmfts_measured *measured, fmfts_several_work *work, const fmfts_ways *ways)
{
    const course c = {model, search, measured, ways->limits, work};
    size_t unknowns = FMFTS_FINGER * fingers.count;
    fmfts_refusal refusal = fmfts_whitener(model, fingers, measured, work);
    if (refusal.kind != FMFTS_FINE) {
        return refusal;
    }
    if (!fmfts_finite(ways->count * unknowns, ways->away) || !fmfts_finite(ways->count * unknowns, ways->direction)) {
        return (fmfts_refusal){FMFTS_NOT_FINITE, 0};
    }
    for (size_t side = 0; side < 2 * ways->count; side++) {
        const double *step = ways->away + side / 2 * unknowns;
        double *moved = ways->there + side * unknowns;
        for (size_t i = 0; i < unknowns; i++) {
            double to = side % 2 ? fingers.at[i] - step[i] : fingers.at[i] + step[i];
            moved[i] = on_the_table(search, ways->limits->least_force_n, i, to);
        }
        ways->chi2[side] = fitted_across(&c, fingers.count, ways->direction + side / 2 * unknowns, moved);
    }
    return refusal;
}
