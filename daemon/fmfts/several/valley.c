/* What a valley of χ² leaves of the fingers' deviations: valley.py explains it. */
#include "fit.h"

#include <math.h>
#include <string.h>

#include "../arithmetic/elementary.h"
#include "../arithmetic/matrix.h"
#include "resultant.h"

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

/* One such step under the root in `work`. The fit's predictions stay, for the poses. */
static bool come_nearer(const course *c, size_t fingers, const double *direction, double *finger)
{
    fmfts_several_work *work = c->work;
    fmfts_predicted *predicted = &work->aside;
    fmfts_predict(c->model, (fmfts_fingers){fingers, finger}, FMFTS_SLOPED, predicted);
    fmfts_whiten(work, work->root, c->measured, predicted->field, work->white);
    fmfts_whiten_slope(predicted->slope, FMFTS_FINGER * fingers, work, work->slope);
    return step_across(c->search, c->limits->least_force_n, FMFTS_FINGER * fingers, direction, work, finger);
}

static double chi2_at(const course *c, size_t fingers, const double *finger)
{
    fmfts_several_work *work = c->work;
    fmfts_predict(c->model, (fmfts_fingers){fingers, finger}, FMFTS_FIELD_ALONE, &work->aside);
    return fmfts_whiten(work, work->root, c->measured, work->aside.field, work->white);
}

/* Moves so many fingers, at `finger`, to the minimum across `direction`. Returns its χ², infinite where there is none. */
static double fitted_across(const course *c, size_t fingers, const double *direction, double *finger)
{
    for (double step = 0.0; step < c->limits->steps; step += 1.0) {
        if (!come_nearer(c, fingers, direction, finger)) {
            return INFINITY;
        }
    }
    return chi2_at(c, fingers, finger);
}

static double log_determinant(const fmfts_several_work *work)
{
    double sum = 0.0;
    for (size_t i = 0; i < work->used; i++) {
        sum += fmfts_log(work->root[(work->used + 1) * i]);
    }
    return 2.0 * sum;
}

/* As fitted_across, of one finger, by the covariance that the values have where it is moved to: by how much -2 log of the
 * likelihood is more than at the fit, whose root is in `work`. */
static double likelihood_across(const course *c, double chi2, const double *direction, double *finger)
{
    fmfts_refusal refusal;
    double before = chi2 + log_determinant(c->work);
    if (!come_nearer(c, 1, direction, finger)) {
        return INFINITY;
    }
    const fmfts_fingers there = {1, finger};
    fmfts_predict(c->model, there, FMFTS_ALL_OF_IT, &c->work->aside);
    if (!fmfts_root_of(c->model, there, &c->work->aside, c->measured, c->work, &refusal) || !come_nearer(c, 1, direction, finger)) {
        return INFINITY;
    }
    return chi2_at(c, 1, finger) + log_determinant(c->work) - before;
}

/* The largest variance (mm²) in any direction of the place whose x is number `first`, and this direction [n]. */
static double weakest(size_t n, const double *covariance, size_t first, double *direction)
{
    double along_x = covariance[(n + 1) * first], along_y = covariance[(n + 1) * (first + 1)];
    double both = covariance[n * first + first + 1], half = 0.5 * (along_x - along_y), root = sqrt(half * half + both * both);
    double x = half >= 0.0 ? half + root : both, y = half >= 0.0 ? both : root - half, size = sqrt(x * x + y * y);
    memset(direction, 0, n * sizeof(double));
    direction[first] = size > 0.0 ? x / size : 1.0;
    direction[first + 1] = size > 0.0 ? y / size : 0.0;
    return 0.5 * (along_x + along_y) + root;
}

static void move(const course *c, fmfts_fingers fingers, const double *away, double share, double *moved)
{
    for (size_t i = 0; i < FMFTS_FINGER * fingers.count; i++) {
        moved[i] = on_the_table(c->search, c->limits->least_force_n, i, fingers.at[i] + away[i] * share);
    }
}

/* Raises `least` to what the fingers at `moved`, whose χ² is `rise` higher, tell of the resultant and of each finger; nothing where
 * that is infinite. */
static void widen(fmfts_fingers fingers, const double *moved, double rise, double least_rise, double *least)
{
    double before[FMFTS_FINGER], after[FMFTS_FINGER];
    if (!isfinite(rise)) {
        return;
    }
    fmfts_resultant(fingers.count, fingers.at, before);
    fmfts_resultant(fingers.count, moved, after);
    for (size_t i = 0; i < FMFTS_FINGER * (1 + fingers.count); i++) {
        double off = i < FMFTS_FINGER ? after[i] - before[i] : moved[i - FMFTS_FINGER] - fingers.at[i - FMFTS_FINGER];
        least[i] = fmax(least[i], off * off / fmax(rise, least_rise));
    }
}

fmfts_refusal fmfts_valley(const fmfts_fitter *fitter, const fmfts_fitted *fitted, const fmfts_measured *measured,
                           const fmfts_valley_limits *limits, fmfts_valley_found *found)
{
    const course c = {fitter->model, fitter->search, measured, limits, fitter->work};
    const fmfts_fingers fingers = fitted->fingers;
    const size_t unknowns = FMFTS_FINGER * fingers.count;
    double direction[FMFTS_SEVERAL_UNKNOWNS], away[FMFTS_SEVERAL_UNKNOWNS], moved[FMFTS_SEVERAL_UNKNOWNS];
    fmfts_refusal refusal = {FMFTS_FINE, 0};
    if (!fmfts_finite(unknowns * unknowns, fitted->covariance)) {
        return (fmfts_refusal){FMFTS_NOT_FINITE, 0};
    }
    found->ways = 0;
    memset(found->least, 0, (FMFTS_FINGER + unknowns) * sizeof(double));
    for (size_t first = 0; first < unknowns; first += FMFTS_FINGER) {
        double variance = weakest(unknowns, fitted->covariance, first, direction);
        if (variance <= limits->unsure_mm * limits->unsure_mm) {
            continue;
        }
        if (!found->ways++) {
            refusal = fmfts_whitener(c.model, fingers, measured, c.work);
        }
        if (refusal.kind != FMFTS_FINE) {
            return refusal;
        }
        fmfts_product(unknowns, unknowns, 1, fitted->covariance, direction, away);
        if (fingers.count == 1) {
            move(&c, fingers, away, (away[2] < 0.0 ? -limits->away : limits->away) / sqrt(variance), moved);
            widen(fingers, moved, likelihood_across(&c, fitted->chi2, direction, moved), limits->least_rise, found->least);
            continue;
        }
        for (int side = 1; side >= -1; side -= 2) {
            double rise = 0.0;
            /* A parabola rises by the square of the deviations; along a valley that still rises less, it goes as far again. */
            for (double far = limits->away; far <= limits->farthest && rise < limits->flat * far * far / 4.0; far *= 2.0) {
                move(&c, fingers, away, side * (far / sqrt(variance)), moved);
                rise = fitted_across(&c, fingers.count, direction, moved) - fitted->chi2;
                widen(fingers, moved, rise, limits->least_rise, found->least);
            }
        }
    }
    return refusal;
}
