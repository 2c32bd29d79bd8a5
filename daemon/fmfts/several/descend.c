/* The search that fit.c and free_poses.c share: the callbacks of arithmetic/descent.c. */
#include <string.h>

#include "fit.h"

void fmfts_normal_equations(const fmfts_several_work *work, size_t n, const double *slope, double *normal, double *right)
{
    memset(normal, 0, n * n * sizeof(double));
    memset(right, 0, n * sizeof(double));
    for (size_t v = 0; v < work->used; v++) {
        const double *row = slope + v * n;
        for (size_t i = 0; i < n; i++) {
            for (size_t j = 0; j < n; j++) {
                normal[i * n + j] += row[i] * row[j];
            }
            right[i] += row[i] * work->white[v];
        }
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

static bool take(void *problem, const double *at, double *chi2, double *normal, double *right)
{
    fmfts_valued *valued = problem;
    fmfts_several_work *work = valued->work;
    size_t unknowns = valued->fingers ? FMFTS_FINGER * valued->fingers : valued->search ? 0 : valued->model->poses;
    fmfts_predicted *before = valued->here;
    if (before) {
        valued->here = valued->there;
        valued->there = before;
    } else {
        valued->here = begin(valued, at);
        valued->there = &work->predicted[valued->here == &work->predicted[0]];
    }
    if (!before || !(fmfts_step_length(unknowns, valued->weighed_at, at, normal) <= valued->stale)) {
        const fmfts_fingers fingers = {valued->fingers, valued->fingers ? at : NULL};
        if (!fmfts_root_of(valued->model, fingers, valued->here, valued->measured, work, &valued->refusal)) {
            return false;
        }
        memcpy(valued->weighed_at, at, unknowns * sizeof(double));
    }
    *chi2 = fmfts_whiten(work, work->root, valued->measured, valued->here->field, work->white);
    fmfts_whiten_slope(valued->fingers ? valued->here->slope : valued->here->by_pose, unknowns, work, valued->slope);
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
    return end == FMFTS_DESCENDED;
}
