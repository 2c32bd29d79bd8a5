/* The present values of a field, in units of their errors: fit.py explains it. */
#include <math.h>
#include <string.h>

#include "../arithmetic/matrix.h"
#include "fit.h"

bool fmfts_list_used(size_t values, const fmfts_measured *measured, fmfts_several_work *work)
{
    work->used = 0;
    for (size_t v = 0; v < values; v++) {
        if (measured->used[v]) {
            bool finite = (!measured->field_t || isfinite(measured->field_t[v])) &&
                          (!measured->variance_t2 || isfinite(measured->variance_t2[v]));
            if (!finite) {
                return false;
            }
            work->index[work->used++] = v;
        }
    }
    return true;
}

bool fmfts_factored(size_t n, double *a, fmfts_refusal *refusal)
{
    bool finite = fmfts_finite(n * n, a);
    if (finite && fmfts_cholesky(n, a)) {
        return true;
    }
    *refusal = (fmfts_refusal){finite ? FMFTS_INDEFINITE : FMFTS_INFINITE, n};
    return false;
}

bool fmfts_root_of(const fmfts_several *model, fmfts_fingers fingers, fmfts_predicted *predicted,
                   const fmfts_measured *measured, fmfts_several_work *work, fmfts_refusal *refusal)
{
    work->rooted.known = 0;
    fmfts_several_covariance(model, fingers, predicted, measured->variance_t2, measured->ambient_t, work);
    for (size_t i = 0; i < work->used; i++) {
        for (size_t j = 0; j < work->used; j++) {
            size_t place = work->index[i] * model->values + work->index[j];
            double foreign = measured->foreign_t2 ? measured->foreign_t2[place] : 0.0;
            work->root[i * work->used + j] = work->covariance[place] + foreign;
        }
    }
    return fmfts_factored(work->used, work->root, refusal);
}

void fmfts_whiten_slope(const double *slope, size_t unknowns, const fmfts_several_work *work, double *white)
{
    for (size_t i = 0; i < work->used; i++) {
        memcpy(white + i * unknowns, slope + work->index[i] * unknowns, unknowns * sizeof(double));
    }
    fmfts_solve_lower(work->used, unknowns, work->root, white);
}

double fmfts_whiten(const fmfts_several_work *work, const double *root, const fmfts_measured *measured,
                    const double *predicted_t, double *white)
{
    double chi2 = 0.0;
    for (size_t i = 0; i < work->used; i++) {
        white[i] = measured->field_t[work->index[i]] - predicted_t[work->index[i]];
    }
    fmfts_solve_lower(work->used, 1, root, white);
    for (size_t i = 0; i < work->used; i++) {
        chi2 += white[i] * white[i];
    }
    return chi2;
}

static bool are_finite(fmfts_fingers fingers)
{
    return fmfts_finite(FMFTS_FINGER * fingers.count, fingers.at);
}

void fmfts_note_root(const fmfts_several *model, fmfts_fingers fingers, const fmfts_measured *measured, const fmfts_several_work *work,
                     fmfts_rooted *rooted)
{
    memset(rooted, 0, sizeof *rooted);
    rooted->known = !measured->foreign_t2;
    rooted->fingers = fingers.count;
    rooted->used = work->used;
    memcpy(rooted->index, work->index, work->used * sizeof(size_t));
    for (size_t i = 0; i < FMFTS_FINGER * fingers.count; i++) {
        rooted->of[i] = fingers.at[i];
    }
    memcpy(rooted->ambient_t, measured->ambient_t, sizeof rooted->ambient_t);
    memcpy(rooted->variance_t2, measured->variance_t2, model->values * sizeof(double));
}

fmfts_refusal fmfts_whitener(const fmfts_several *model, fmfts_fingers fingers, const fmfts_measured *measured,
                             fmfts_several_work *work)
{
    fmfts_refusal refusal = {FMFTS_NOT_FINITE, 0};
    fmfts_rooted wanted;
    if (fmfts_list_used(model->values, measured, work) && are_finite(fingers) && fmfts_finite(3, measured->ambient_t)) {
        refusal.kind = FMFTS_FINE;
        fmfts_note_root(model, fingers, measured, work, &wanted);
        if (wanted.known && !memcmp(&wanted, &work->rooted, sizeof wanted)) {
            return refusal;
        }
        fmfts_predicted *predicted = &work->predicted[fmfts_predict_in(model, fingers, work)];
        if (fmfts_root_of(model, fingers, predicted, measured, work, &refusal)) {
            memcpy(&work->rooted, &wanted, sizeof wanted);
        }
    }
    return refusal;
}

fmfts_refusal fmfts_chi2_with(const fmfts_several *model, const double *root, fmfts_fingers fingers,
                              const fmfts_measured *measured, fmfts_several_work *work, double *chi2)
{
    fmfts_refusal refusal = {FMFTS_NOT_FINITE, 0};
    if (fmfts_list_used(model->values, measured, work) && are_finite(fingers) &&
        fmfts_finite(work->used * work->used, root)) {
        refusal.kind = FMFTS_FINE;
        const fmfts_predicted *predicted = &work->predicted[fmfts_predict_in(model, fingers, work)];
        *chi2 = fmfts_whiten(work, root, measured, predicted->field, work->white);
    }
    return refusal;
}
