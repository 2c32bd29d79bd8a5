/* The pose filter: Smoother of smoothing.py. */
#include <math.h>
#include <string.h>

#include "../arithmetic/elementary.h"
#include "step.h"

enum { POSE = FMFTS_POSE, COMPONENTS = 5 };

static const double UNIT[POSE] = {1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0}; /* mm → m; the axis is a number */

/* χ² of an innovation: its variance is less than twice that of the pose. False if that is no covariance. */
static bool chi2_of(const double *innovation, const double *covariance, double *chi2)
{
    double moved[COMPONENTS], expected[COMPONENTS * COMPONENTS];
    for (int i = 0; i < COMPONENTS; i++) {
        moved[i] = innovation[i] / UNIT[i];
        for (int j = 0; j < COMPONENTS; j++) {
            expected[COMPONENTS * i + j] = 2.0 * covariance[POSE * i + j];
        }
    }
    return fmfts_chi2_from_rest(moved, expected, chi2);
}

bool fmfts_smooth(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, double elapsed_s,
                  fmfts_question *question)
{
    double pose[POSE], predicted[POSE], innovation[POSE], chi2 = 0.0, square = 0.0;
    if (!(parameters->smoothing_s[0] > 0.0)) {
        return true;
    }
    for (int i = 0; i < POSE; i++) {
        pose[i] = question->pose[i] * UNIT[i];
        predicted[i] = memory->pose[i] + (memory->speed[i] + memory->acceleration[i] * elapsed_s / 2.0) * elapsed_s;
        innovation[i] = pose[i] - predicted[i];
    }
    if (elapsed_s > 0.0 && !chi2_of(innovation, question->covariance, &chi2)) {
        return false;
    }
    if (!(elapsed_s > 0.0 && chi2 <= parameters->smoothing_jump_chi2[0])) {
        memcpy(memory->pose, pose, sizeof pose);
        memset(memory->speed, 0, sizeof memory->speed);
        memset(memory->acceleration, 0, sizeof memory->acceleration);
        return true;
    }
    double fading = fmfts_exp(-elapsed_s / parameters->smoothing_s[0]), fresh = 1.0 - fading;
    for (int i = 0; i < POSE; i++) {
        memory->pose[i] = predicted[i] + (1.0 - fading * fading * fading) * innovation[i];
        memory->speed[i] += memory->acceleration[i] * elapsed_s +
                            1.5 * (fresh * fresh) * (1.0 + fading) / elapsed_s * innovation[i];
        memory->acceleration[i] += fresh * fresh * fresh / (elapsed_s * elapsed_s) * innovation[i];
    }
    for (int i = 3; i < POSE; i++) {
        square += memory->pose[i] * memory->pose[i];
    }
    for (int i = 0; i < POSE; i++) {
        memory->pose[i] /= i < 3 ? 1.0 : sqrt(square);
        question->pose[i] = memory->pose[i] / UNIT[i];
    }
    return true;
}
