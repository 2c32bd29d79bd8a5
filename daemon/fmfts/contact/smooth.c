/* A filter of the pose ([pad.contact] smoothing_ms), for fingers that move slowly and numbers with little noise.
 *
 * It is an α-β-γ filter: least squares with fading memory, through the pose, its speed and its acceleration (Morrison,
 * "Introduction to sequential smoothing and prediction", 1969). It follows a finger that moves at constant speed without lag,
 * although the magnet below it sinks and rises in a curve. If the pose jumps by more than noise explains, the filter starts
 * again from it, so a press is not seen later. Deviations remain those of a single frame: the filter does not know which part
 * of them is the same in every frame (gains, places, ambient field), and they must not become too small.
 */
#include <math.h>
#include <string.h>

#include "../arithmetic/elementary.h"
#include "step.h"

enum { POSE = FMFTS_POSE, COMPONENTS = 5 };

static const double UNIT[POSE] = {1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0}; /* mm → m; the axis is a number */

/* Whether noise does not explain the innovation, whose variance is less than twice that of the pose. */
static bool has_jumped(const fmfts_contact_parameters *parameters, const double *innovation, const double *covariance)
{
    double moved[COMPONENTS], expected[COMPONENTS * COMPONENTS], chi2;
    for (int i = 0; i < COMPONENTS; i++) {
        moved[i] = innovation[i] / UNIT[i];
        for (int j = 0; j < COMPONENTS; j++) {
            expected[COMPONENTS * i + j] = 2.0 * covariance[POSE * i + j];
        }
    }
    return !fmfts_chi2_from_rest(COMPONENTS, moved, expected, &chi2) || chi2 > parameters->smoothing_jump_chi2;
}

static void begin(fmfts_contact_memory *memory, const double *pose)
{
    memory->smooths = 1;
    memcpy(memory->pose, pose, sizeof memory->pose);
    memset(memory->speed, 0, sizeof memory->speed);
    memset(memory->acceleration, 0, sizeof memory->acceleration);
}

static void go_on(fmfts_contact_memory *memory, const double *predicted, const double *innovation, double fading,
                  double elapsed_s)
{
    double square = 0.0, fresh = 1.0 - fading;
    for (int i = 0; i < POSE; i++) {
        memory->pose[i] = predicted[i] + (1.0 - fading * fading * fading) * innovation[i];
        memory->speed[i] += memory->acceleration[i] * elapsed_s +
                            1.5 * (fresh * fresh) * (1.0 + fading) / elapsed_s * innovation[i];
        memory->acceleration[i] += fresh * fresh * fresh / (elapsed_s * elapsed_s) * innovation[i];
        square += i < 3 ? 0.0 : memory->pose[i] * memory->pose[i];
    }
    for (int i = 3; i < POSE; i++) {
        memory->pose[i] /= sqrt(square);
    }
}

void fmfts_smooth(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, double elapsed_s,
                  fmfts_question *question)
{
    double pose[POSE], predicted[POSE], innovation[POSE];
    if (!(parameters->smoothing_s > 0.0)) {
        return;
    }
    for (int i = 0; i < POSE; i++) {
        pose[i] = question->pose[i] * UNIT[i];
        predicted[i] = memory->pose[i] + (memory->speed[i] + memory->acceleration[i] * elapsed_s / 2.0) * elapsed_s;
        innovation[i] = pose[i] - predicted[i];
    }
    if (!memory->smooths || !(elapsed_s > 0.0) || has_jumped(parameters, innovation, question->covariance)) {
        begin(memory, pose);
        return;
    }
    go_on(memory, predicted, innovation, fmfts_exp(-elapsed_s / parameters->smoothing_s), elapsed_s);
    for (int i = 0; i < POSE; i++) {
        question->pose[i] = memory->pose[i] / UNIT[i];
    }
}
