/* Decides whether the pad is touched: touch.py. */
#include <math.h>

#include "../pose/algebra.h"
#include "step.h"

/* χ² of the change. False if the covariance is not positive definite. */
bool fmfts_chi2_from_rest(const double *change, const double *covariance, double *chi2)
{
    fmfts_matrix a, work;
    double solved[5];
    for (size_t i = 0; i < 5; i++) {
        solved[i] = change[i];
        for (size_t j = i; j < 5; j++) {
            a[i][j] = covariance[5 * i + j];
        }
    }
    if (!factor(5, a, 0.0, work)) {
        return false;
    }
    solve_factored(5, work, solved);
    *chi2 = 0.0;
    for (int i = 0; i < 5; i++) {
        *chi2 += change[i] * solved[i];
    }
    return isfinite(*chi2);
}

static void follow(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, double chi2)
{
    memory->quiet_frames[0] = chi2 < parameters->release_chi2[0] ? memory->quiet_frames[0] + 1.0 : 0.0;
    if (chi2 > parameters->onset_chi2[0]) {
        memory->touched[0] = 1.0;
    } else if (memory->quiet_frames[0] >= parameters->release_frames[0]) {
        memory->touched[0] = 0.0;
    }
}

bool fmfts_touch(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, const double *change,
                 const double *covariance, double elapsed_s)
{
    double chi2;
    if (elapsed_s > parameters->longest_gap_s[0]) { /* who touched may be gone: TouchDetector.forget */
        memory->touched[0] = memory->quiet_frames[0] = memory->in_contact[0] = 0.0;
    }
    if (!fmfts_chi2_from_rest(change, covariance, &chi2)) {
        return false;
    }
    follow(parameters, memory, chi2);
    return true;
}

void fmfts_press(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, const fmfts_estimate *estimate)
{
    double needed = memory->in_contact[0] != 0.0 ? parameters->kept_force_deviations[0] : parameters->certain_force_deviations[0];
    double hidden_n = parameters->hidden_force_sd_n[0];
    double deviation_n = estimate->pose_force_sd_n;
    if (hidden_n > 0.0) {
        deviation_n = estimate->deviation[2] > hidden_n ? estimate->deviation[2] : hidden_n;
    }
    bool is_certain = estimate->refused || estimate->place[2] > needed * deviation_n;
    memory->in_contact[0] = memory->touched[0] != 0.0 && is_certain ? 1.0 : 0.0;
}
