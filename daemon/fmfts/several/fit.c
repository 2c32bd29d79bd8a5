/* Finds the fingers that best explain a field, near where it starts: fit.py explains it. */
#include "fit.h"

#include <math.h>
#include <string.h>

#include "../arithmetic/matrix.h"

/* The limits on number `i` of the fingers. */
static double within(const fmfts_search *search, size_t i, double value)
{
    return fmfts_within(value, search->head->lowest[i % FMFTS_FINGER], search->head->highest[i % FMFTS_FINGER]);
}

static void predict(const fmfts_valued *valued, const double *finger, fmfts_predicted *predicted)
{
    fmfts_predict(valued->model, (fmfts_fingers){valued->fingers, finger}, FMFTS_ALL_OF_IT, predicted);
}

/* No finger moves farther than longest_step_mm at once. */
static void shorten(void *problem, double *step)
{
    const fmfts_valued *valued = problem;
    const fmfts_search_head *head = valued->search->head;
    double longest = head->least_step_mm;
    for (size_t i = 0; i < FMFTS_FINGER * valued->fingers; i++) {
        if (i % FMFTS_FINGER < 2 && fabs(step[i]) > longest) {
            longest = fabs(step[i]);
        }
    }
    double share = head->longest_step_mm / longest;
    for (size_t i = 0; share < 1.0 && i < FMFTS_FINGER * valued->fingers; i++) {
        step[i] *= share;
    }
}

/* Moves `finger` to the minimum. Returns what is predicted there, NULL where a matrix is refused. */
static const fmfts_predicted *descend(fmfts_valued *valued, double *finger, double *chi2)
{
    const fmfts_search_head *head = valued->search->head;
    double lowest[FMFTS_SEVERAL_UNKNOWNS], highest[FMFTS_SEVERAL_UNKNOWNS], floor[FMFTS_SEVERAL_UNKNOWNS];
    fmfts_descent search = {
        .unknowns = FMFTS_FINGER * valued->fingers,
        .iterations = (size_t)head->iterations,
        .settled = head->settled,
        .rounding = head->rounding,
        .damping = head->damping,
        .damping_factor = head->damping_factor,
        .most_damping = head->most_damping,
        .lowest = lowest,
        .highest = highest,
        .floor = floor,
        .shorten = shorten,
    };
    for (size_t i = 0; i < search.unknowns; i++) {
        lowest[i] = head->lowest[i % FMFTS_FINGER];
        highest[i] = head->highest[i % FMFTS_FINGER];
        floor[i] = head->floor[i % FMFTS_FINGER];
    }
    return fmfts_find_minimum(valued, &search, finger, chi2) ? valued->here : NULL;
}

bool fmfts_spread(const fmfts_search *search, size_t n, const fmfts_several_work *work, double *right, double *covariance)
{
    double normal[FMFTS_SEVERAL_UNKNOWNS * FMFTS_SEVERAL_UNKNOWNS], room[FMFTS_DESCENT_ROOM(FMFTS_SEVERAL_UNKNOWNS)];
    double floor[FMFTS_SEVERAL_UNKNOWNS];
    fmfts_normal_equations(work, n, work->slope, normal, right);
    for (size_t i = 0; i < n; i++) {
        floor[i] = search->head->floor[i % FMFTS_FINGER];
    }
    if (fmfts_spread_of(n, floor, normal, covariance, room)) {
        return true;
    }
    for (size_t i = 0; i < n * n; i++) {
        covariance[i] = INFINITY;
    }
    return false;
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

void fmfts_noise_of(size_t values, const fmfts_measured *measured, const fmfts_several_work *work, double *noise_t)
{
    double inner[FMFTS_SEVERAL_VALUES];
    memcpy(inner, work->white, work->used * sizeof(double));
    fmfts_solve_lower_transposed(work->used, 1, work->root, inner);
    memset(noise_t, 0, values * sizeof(double));
    for (size_t i = 0; i < work->used; i++) {
        noise_t[work->index[i]] = measured->variance_t2[work->index[i]] * inner[i];
    }
}

/* Whether a finger is too weak, or two are too near to each other; and whether one is beyond the table. */
static int flags_of(const fmfts_several *model, const fmfts_search_head *head, size_t fingers, const fmfts_found *found)
{
    const double *at = found->fingers;
    double across = fingers > 1 ? at[0] - at[FMFTS_FINGER] : 0.0, along = fingers > 1 ? at[1] - at[FMFTS_FINGER + 1] : 0.0;
    int flags = fingers > 1 && sqrt(across * across + along * along) < head->together_mm ? FMFTS_DOUBTFUL : 0;
    for (size_t f = 0; f < fingers; f++, at += FMFTS_FINGER) {
        double variance_n2 = found->covariance[(FMFTS_FINGER * fingers + 1) * (FMFTS_FINGER * f + 2)];
        double deviation_n = sqrt(variance_n2 > 0.0 ? variance_n2 : 0.0);
        bool inside = fmin(at[0], at[1]) > head->lowest[0] + head->edge_mm && fmax(at[0], at[1]) < head->highest[0] - head->edge_mm;
        bool beyond = at[2] > model->head->scale_n || (at[2] > head->certain_deviations * deviation_n && !inside);
        flags |= (at[2] < head->release_deviations * deviation_n ? FMFTS_DOUBTFUL : 0) | (beyond ? FMFTS_BEYOND : 0);
    }
    return flags;
}

fmfts_refusal fmfts_several_fit(const fmfts_several *model, const fmfts_search *search, fmfts_fingers start,
                                const fmfts_measured *measured, fmfts_several_work *work, fmfts_found *found)
{
    double unused[FMFTS_SEVERAL_UNKNOWNS];
    fmfts_refusal refusal = {FMFTS_NOT_FINITE, 0};
    const size_t unknowns = FMFTS_FINGER * start.count;
    if (!fmfts_list_used(model->values, measured, work) || !fmfts_finite(unknowns, start.at) ||
        !fmfts_finite(3, measured->ambient_t)) {
        return refusal;
    }
    refusal.kind = FMFTS_FINE;
    for (size_t i = 0; i < unknowns; i++) {
        found->fingers[i] = within(search, i, start.at[i]);
    }
    fmfts_valued valued = {
        .model = model,
        .search = search,
        .measured = measured,
        .work = work,
        .fingers = start.count,
        .slope = work->slope,
        .predict = predict,
        .stale = start.count == 1 ? search->head->stale : 0.0,
        .refusal = refusal,
    };
    const fmfts_predicted *at = descend(&valued, found->fingers, &found->chi2);
    if (!at) {
        return valued.refusal;
    }
    fmfts_note_root(model, (fmfts_fingers){start.count, found->fingers}, measured, work, &work->rooted);
    found->flags = fmfts_spread(search, unknowns, work, unused, found->covariance) ? 0 : FMFTS_UNDETERMINED;
    found->flags |= flags_of(model, search->head, start.count, found);
    fmfts_ambient_of(model, work, found->ambient_t);
    fmfts_shear_of(model, (fmfts_fingers){start.count, found->fingers}, found->covariance, work, found->shear_n,
                   found->shear_deviation_n);
    fmfts_noise_of(model->values, measured, work, found->noise_t);
    memcpy(found->slope_t, at->slope, model->values * unknowns * sizeof(double));
    for (size_t v = 0; v < model->values; v++) {
        found->misfit_t[v] = measured->field_t[v] - at->field[v];
    }
    return refusal;
}
