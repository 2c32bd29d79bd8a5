/* Finds the fingers that best explain a field, near where it starts: fit.py explains it. */
#include "fit.h"

#include <math.h>
#include <string.h>

#include "../arithmetic/matrix.h"

static double clamped(double value, double lowest, double highest)
{
    double raised = lowest > value ? lowest : value;
    return highest < raised ? highest : raised;
}

/* The search's limits on number `i` of the fingers. */
static double within(const fmfts_search *search, size_t i, double value)
{
    return clamped(value, search->head->lowest[i % FMFTS_FINGER], search->head->highest[i % FMFTS_FINGER]);
}

/* out [columns][columns] = slope' · slope, and right [columns] = slope' · white, of slope [used][columns]. */
static void normal_equations(const fmfts_several_work *work, size_t columns, const double *slope, const double *white,
                             double *out, double *right)
{
    memset(out, 0, columns * columns * sizeof(double));
    memset(right, 0, columns * sizeof(double));
    for (size_t v = 0; v < work->used; v++) {
        const double *row = slope + v * columns;
        for (size_t i = 0; i < columns; i++) {
            for (size_t j = 0; j < columns; j++) {
                out[i * columns + j] += row[i] * row[j];
            }
            right[i] += row[i] * white[v];
        }
    }
}

void fmfts_whiten_slope(const fmfts_predicted *predicted, size_t unknowns, fmfts_several_work *work)
{
    for (size_t i = 0; i < work->used; i++) {
        memcpy(work->slope + i * unknowns, predicted->slope + work->index[i] * unknowns, unknowns * sizeof(double));
    }
    fmfts_solve_lower(work->used, unknowns, work->root, work->slope);
}

/* What keeps the normal matrix regular where the values say nothing of a finger: see FLOOR of fit.py. */
static double floor_of(const fmfts_search *search, size_t i)
{
    return search->head->floor[i % FMFTS_FINGER];
}

/* trial: where a damped step from `finger` leads. diagonal: of the normal matrix. */
static bool step_from(const fmfts_search *search, size_t unknowns, const double *finger, double damping,
                      fmfts_several_work *work, double *diagonal, double *trial, fmfts_refusal *refusal)
{
    double normal[FMFTS_SEVERAL_UNKNOWNS * FMFTS_SEVERAL_UNKNOWNS], step[FMFTS_SEVERAL_UNKNOWNS], longest = 0.0;
    normal_equations(work, unknowns, work->slope, work->white, normal, step);
    for (size_t i = 0; i < unknowns; i++) {
        diagonal[i] = normal[i * unknowns + i];
        normal[i * unknowns + i] += damping * diagonal[i] + floor_of(search, i);
    }
    if (!fmfts_factored(unknowns, normal, refusal)) {
        return false;
    }
    fmfts_solve_lower(unknowns, 1, normal, step);
    fmfts_solve_lower_transposed(unknowns, 1, normal, step);
    if (!fmfts_finite(unknowns, step)) {
        *refusal = (fmfts_refusal){FMFTS_INFINITE, unknowns};
        return false;
    }
    for (size_t i = 0; i < unknowns; i++) {
        if (i % FMFTS_FINGER < 2 && fabs(step[i]) > longest) {
            longest = fabs(step[i]);
        }
    }
    double least = search->head->least_step_mm;
    double share = search->head->longest_step_mm / (least > longest ? least : longest);
    for (size_t i = 0; i < unknowns; i++) {
        trial[i] = within(search, i, finger[i] + step[i] * (share < 1.0 ? share : 1.0));
    }
    return true;
}

/* Moves `finger` to the minimum. The covariance, its root and what is white are left as they are there. Returns what is
 * predicted there, NULL where a matrix is refused. */
static const fmfts_predicted *descend(const fmfts_several *model, const fmfts_search *search, size_t fingers,
                                      double *finger, const fmfts_measured *measured, const double *ambient_t,
                                      fmfts_several_work *work, double *chi2, fmfts_refusal *refusal)
{
    const fmfts_search_head *head = search->head;
    size_t unknowns = FMFTS_FINGER * fingers;
    fmfts_predicted *here = &work->predicted[0], *there = &work->predicted[1];
    double diagonal[FMFTS_SEVERAL_UNKNOWNS], trial[FMFTS_SEVERAL_UNKNOWNS], after[FMFTS_SEVERAL_VALUES];
    double damping = head->damping;
    fmfts_predict(model, fingers, finger, here);
    if (!fmfts_root_of(model, fingers, finger, here, measured, ambient_t, work, refusal)) {
        return NULL;
    }
    *chi2 = fmfts_whiten(work, work->root, measured, here->field, work->white);
    fmfts_whiten_slope(here, unknowns, work);
    for (size_t i = 0; unknowns && i < (size_t)head->iterations; i++) {
        if (!step_from(search, unknowns, finger, damping, work, diagonal, trial, refusal)) {
            return NULL;
        }
        fmfts_predict(model, fingers, trial, there);
        if (fmfts_whiten(work, work->root, measured, there->field, after) > *chi2 * (1.0 + head->rounding)) {
            damping *= head->damping_factor;
            if (damping > head->most_damping) {
                break;
            }
            continue;
        }
        double longest = 0.0;
        for (size_t j = 0; j < unknowns; j++) {
            double moved = fabs((trial[j] - finger[j]) * sqrt(diagonal[j]));
            longest = moved > longest ? moved : longest;
        }
        memcpy(finger, trial, unknowns * sizeof(double));
        fmfts_predicted *before = here;
        here = there;
        there = before;
        damping /= head->damping_factor;
        if (!fmfts_root_of(model, fingers, finger, here, measured, ambient_t, work, refusal)) {
            return NULL;
        }
        *chi2 = fmfts_whiten(work, work->root, measured, here->field, work->white);
        fmfts_whiten_slope(here, unknowns, work);
        if (longest < head->settled) {
            break;
        }
    }
    return here;
}

bool fmfts_spread(const fmfts_search *search, size_t n, const fmfts_several_work *work, double *right, double *covariance)
{
    double normal[FMFTS_SEVERAL_UNKNOWNS * FMFTS_SEVERAL_UNKNOWNS];
    double half[FMFTS_SEVERAL_UNKNOWNS * FMFTS_SEVERAL_UNKNOWNS];
    fmfts_refusal refusal;
    normal_equations(work, n, work->slope, work->white, normal, right);
    for (size_t i = 0; i < n; i++) {
        normal[i * n + i] += floor_of(search, i);
        for (size_t j = 0; j < n; j++) {
            half[i * n + j] = i == j ? 1.0 : 0.0;
        }
    }
    if (!fmfts_factored(n, normal, &refusal)) {
        for (size_t i = 0; i < n * n; i++) {
            covariance[i] = INFINITY;
        }
        return false;
    }
    fmfts_solve_lower(n, n, normal, half);
    memset(covariance, 0, n * n * sizeof(double));
    for (size_t k = 0; k < n; k++) {
        for (size_t i = 0; i < n; i++) {
            for (size_t j = 0; j < n; j++) {
                covariance[i * n + j] += half[k * n + i] * half[k * n + j];
            }
        }
    }
    return true;
}

void fmfts_ambient_of(const fmfts_several *model, const fmfts_several_work *work, double *ambient)
{
    double toward[FMFTS_SEVERAL_VALUES * 3], sigma = model->head->ambient_t;
    for (size_t i = 0; i < 3 * work->used; i++) {
        toward[i] = model->by_ambient[i % 3 * model->stride + work->index[i / 3]];
    }
    fmfts_solve_lower(work->used, 3, work->root, toward);
    for (size_t axis = 0; axis < 3; axis++) {
        double sum = 0.0;
        for (size_t i = 0; i < work->used; i++) {
            sum += toward[3 * i + axis] * work->white[i];
        }
        ambient[axis] = sigma * sigma * sum;
    }
}

fmfts_refusal fmfts_several_fit(const fmfts_several *model, const fmfts_search *search, size_t fingers,
                                const double *start, const fmfts_measured *measured, const double *ambient_t,
                                fmfts_several_work *work, fmfts_found *found)
{
    double unused[FMFTS_SEVERAL_UNKNOWNS];
    fmfts_refusal refusal = {FMFTS_NOT_FINITE, 0};
    if (!fmfts_list_used(model->values, measured, work) || !fmfts_finite(FMFTS_FINGER * fingers, start) ||
        !fmfts_finite(3, ambient_t)) {
        return refusal;
    }
    refusal.kind = FMFTS_FINE;
    for (size_t i = 0; i < FMFTS_FINGER * fingers; i++) {
        found->fingers[i] = within(search, i, start[i]);
    }
    const fmfts_predicted *at =
        descend(model, search, fingers, found->fingers, measured, ambient_t, work, &found->chi2, &refusal);
    if (!at) {
        return refusal;
    }
    fmfts_spread(search, FMFTS_FINGER * fingers, work, unused, found->covariance);
    fmfts_ambient_of(model, work, found->ambient_t);
    fmfts_shear_of(model, fingers, found->fingers, found->covariance, work, found->shear_n, found->shear_deviation_n);
    for (size_t v = 0; v < model->values; v++) {
        found->misfit_t[v] = measured->field_t[v] - at->field[v];
    }
    return refusal;
}
