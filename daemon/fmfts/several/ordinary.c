/* Most frames: all values are there, and the fingers of the frame before explain them. estimator.py looks closer at all others. */
#include "ordinary.h"

#include <math.h>

void fmfts_read_ordinary(const fmfts_fitter *fitter, const fmfts_ordinary_limits *limits, const fmfts_frame_before *last,
                         fmfts_rest_samples *samples, const fmfts_rest_change *change, fmfts_ordinary *found)
{
    const fmfts_fingers before = last->fingers;
    const fmfts_several *model = fitter->model;
    fmfts_several_work *work = fitter->work;
    const fmfts_measured measured = {change->change_t, change->variance_t2, change->there, NULL, last->ambient_t};
    samples->now_t = before.count ? work->predicted[fmfts_predict_in(model, before, work)].field : NULL;
    found->has_jumped = fmfts_since_rest(model->values, samples, change);                       /* since_rest.c */
    found->has_fit = found->is_ordinary = false;
    found->fit.flags = 0;
    found->fit.chi2 = NAN;
    if (!fmfts_list_used(model->values, &measured, work) || work->used < model->values) {
        return;
    }
    fmfts_refusal refusal = fmfts_several_fit(model, fitter->search, before, &measured, work, &found->fit); /* fit.c */
    found->has_fit = refusal.kind == FMFTS_FINE;
    if (!found->has_fit || found->fit.flags || !(found->fit.chi2 <= limits->most_chi2[before.count])) {
        return;
    }
    const fmfts_fingers fingers = {before.count, found->fit.fingers};
    const fmfts_fitted fitted = {fingers, found->fit.covariance, found->fit.misfit_t, found->fit.chi2};
    if (fingers.count) {
        refusal = fmfts_poses_of(model, limits->unfelt, &fitted, &measured, work, &found->poses); /* poses.c */
    }
    /* Last: of one finger it leaves another root. */
    if (fingers.count && refusal.kind == FMFTS_FINE) {
        refusal = fmfts_valley(fitter, &fitted, &measured, &limits->valley, &found->valley);    /* valley.c */
    }
    found->is_ordinary = refusal.kind == FMFTS_FINE;
}
