/* The search that fit.c and free_poses.c share: the callbacks of arithmetic/descent.c. */
#include <string.h>

#include "fit.h"

FMFTS_WIDE void fmfts_normal_equations(const fmfts_several_work *work, size_t n, const double *slope, double *normal, double *right)
{
    memset(normal, 0, n * n * sizeof(double));
    memset(right, 0, n * sizeof(double));
    for (size_t v = 0; v < work->used; v++) {
        const double *row = slope + v * n;
        for (size_t i = 0; i < n; i++) {
            for (size_t j = 0; j <= i; j++) {
                normal[i * n + j] += row[i] * row[j];
            }
            right[i] += row[i] * work->white[v];
        }
    }
    for (size_t i = 0; i < n * n; i++) {
        normal[i] = normal[i / n >= i % n ? i : i % n * n + i / n];
    }
}

static double judge(void *problem, const double *trial)
{
    fmfts_valued *valued = problem;
    double white[FMFTS_SEVERAL_VALUES];
    valued->predict(valued, trial, valued->there);
    return fmfts_whiten(valued->work, valued->work->root, valued->measured, valued->there->field, white);
}

/* The prediction at the start. */
static fmfts_predicted *begin(const fmfts_valued *valued, const double *at)
{
    fmfts_several_work *work = valued->work;
    if (valued->search) {
        return &work->predicted[fmfts_predict_in(valued->model, (fmfts_fingers){valued->fingers, at}, work)];
    }
    valued->predict(valued, at, &work->predicted[0]);
    return &work->predicted[0];
}

static size_t unknowns_of(const fmfts_valued *valued)
{
    return valued->fingers ? FMFTS_FINGER * valued->fingers : valued->search ? 0 : valued->model->poses;
}

/* The values' covariance is that at `at`. */
static bool weigh(fmfts_valued *valued, const double *at)
{
    const fmfts_fingers fingers = {valued->fingers, valued->fingers ? at : NULL};
    memcpy(valued->weighed_at, at, unknowns_of(valued) * sizeof(double));
    return fmfts_root_of(valued->model, fingers, valued->here, valued->measured, valued->work, &valued->refusal);
}

/* χ² there, and the values' slope over their deviations. */
static double whiten(fmfts_valued *valued)
{
    fmfts_several_work *work = valued->work;
    const fmfts_predicted *here = valued->here;
    fmfts_whiten_slope(valued->fingers ? here->slope : here->by_pose, unknowns_of(valued), work, valued->slope);
    return fmfts_whiten(work, work->root, valued->measured, here->field, work->white);
}

static bool take(void *problem, const double *at, double *chi2, double *normal, double *right)
{
    fmfts_valued *valued = problem;
    fmfts_several_work *work = valued->work;
    size_t unknowns = unknowns_of(valued);
    fmfts_predicted *before = valued->here;
    if (before) {
        valued->here = valued->there;
        valued->there = before;
    } else {
        valued->here = begin(valued, at);
        valued->there = &work->predicted[valued->here == &work->predicted[0]];
    }
    if ((!before || !(fmfts_step_length(unknowns, valued->weighed_at, at, normal) <= valued->stale)) && !weigh(valued, at)) {
        return false;
    }
    *chi2 = whiten(valued);
    fmfts_normal_equations(work, unknowns, valued->slope, normal, right);
    return true;
}

bool fmfts_find_minimum(fmfts_valued *valued, fmfts_descent *search, double *at, double *chi2)
{
    double room[FMFTS_DESCENT_ROOM(FMFTS_SEVERAL_POSES)];
    search->problem = valued;
    search->judge = judge;
    search->take = take;
    fmfts_descent_end end = fmfts_descend(search, at, chi2, room);
    if (end == FMFTS_NO_STEP || end == FMFTS_NO_NUMBER) {
        valued->refusal = (fmfts_refusal){end == FMFTS_NO_STEP ? FMFTS_INDEFINITE : FMFTS_INFINITE, search->unknowns};
    }
    if (end != FMFTS_DESCENDED || !memcmp(valued->weighed_at, at, unknowns_of(valued) * sizeof(double))) {
        return end == FMFTS_DESCENDED;
    }
    bool weighed = weigh(valued, at);
    *chi2 = weighed ? whiten(valued) : *chi2;
    return weighed;
}
