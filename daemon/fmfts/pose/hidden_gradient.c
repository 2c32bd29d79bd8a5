/* The uncertainty of a change of pose from a foreign field without a residual.
 *
 * If the ambient field is estimated, the estimate includes a foreign field's uniform part. Four sensors around a magnet
 * detect two of the five components of its gradient. The others look like a press: xx + yy like a change of height, xz
 * and yz like a shift with a tilt. But the uniform part reveals it: the Earth's field turns with the robot, but keeps
 * its strength; where the robot stands still, it keeps its direction, too. So
 *
 *     strange = |reference + change| − |reference|      (reference: the Earth's field at the baseline, or 0)
 *     σ² = even_t² + b̂ᵀCb̂ + Σₘ (b̂·eₘ)² + iron_t²·|b̂ − b̂₀|²   (b̂, b̂₀: directions of reference + change, of reference)
 *     foreign² = max(strange² − (healthy_deviations·σ)², 0)
 *
 * with C the change's covariance, and eₘ the errors that the baseline leaves. iron: the field of a magnet that turns
 * with the pad, which the reference includes; a turn of the robot measures it. The covariance of the change of pose
 * then grows by foreign²·unit_gradient, which hidden_gradient.py computes.
 */
#include <math.h>

#include "model.h"
#include "step.h"
#include "tracking.h"

/* A passing tool rotates its field: at some moments the sum is as strong as the Earth's field alone. So a detected
 * field fades slowly. */
#define FADES_S 1.0

/* The variance of what turns along with the pad. */
static double of_iron(const fmfts_pose_parameters *parameters, const fmfts_reference *reference, const double *direction)
{
    double square = 0.0, iron_t = parameters->iron_t;
    for (int i = 0; iron_t > 0.0 && i < 3; i++) {
        double turned = direction[i] - reference->field_t[i] / reference->strength_t;
        square += turned * turned;
    }
    return iron_t * iron_t * square;
}

/* The variance of the strength along the unit vector `direction`. */
static double variance_along(const fmfts_pose_parameters *parameters, const fmfts_reference *reference,
                             const double change[FMFTS_CHANGE], const double *direction, const fmfts_pose *pose)
{
    int errors = (int)parameters->ambient_errors;
    double along[3], of_frame = 0.0, of_baseline = 0.0;
    for (int j = 0; j < 3; j++) {
        along[j] = 0.0;
        for (int i = 0; i < 3; i++) {
            along[j] += direction[i] * pose->covariance[FMFTS_STEP * (AMBIENT_COLUMN + i) + AMBIENT_COLUMN + j];
        }
        of_frame += along[j] * direction[j];
    }
    for (int m = 0; m < errors; m++) {
        double error = 0.0;
        for (int i = 0; i < 3; i++) {
            double by_change = 0.0;
            for (int by = 0; by < FMFTS_CHANGE; by++) {
                by_change += change[by] * parameters->ambient_error[(by * 3 + i) * errors + m];
            }
            error += direction[i] * by_change;
        }
        of_baseline += error * error;
    }
    return parameters->even_t * parameters->even_t + of_frame + of_baseline + of_iron(parameters, reference, direction);
}

static double foreign_t(const fmfts_pose_parameters *parameters, const fmfts_reference *reference, const double *state,
                        const fmfts_pose *pose)
{
    double change[FMFTS_CHANGE], total[3], healthy = parameters->healthy_deviations;
    for (int i = 0; i < 3; i++) {
        total[i] = reference->field_t[i] + state[AMBIENT_VALUE + i];
    }
    double strength = sqrt(dot3(total, total)), strange = strength - reference->strength_t;
    if (!(fabs(strange) > healthy * parameters->even_t)) {
        return 0.0; /* also with an unknown reference */
    }
    fmfts_change(parameters, state, change);
    for (int i = 0; i < 3; i++) {
        change[5 + i] = state[AMBIENT_VALUE + i];
        total[i] /= strength;
    }
    double beyond = strange * strange - healthy * healthy * variance_along(parameters, reference, change, total, pose);
    return sqrt(fmax(beyond, 0.0));
}

/* Why a frame with this change of the ambient field cannot be used. */
static void say_why(const fmfts_reference *reference, const double ambient_t[3], fmfts_text *reason)
{
    double total[3];
    for (int i = 0; i < 3; i++) {
        total[i] = reference->field_t[i] + ambient_t[i];
    }
    fmfts_clear(reason);
    if (reference->strength_t == 0.0) {
        fmfts_say(reason, "the ambient field has changed by %.0f mG", sqrt(dot3(ambient_t, ambient_t)) * 1e7);
    } else {
        double share = sqrt(dot3(total, total)) / reference->strength_t - 1.0;
        fmfts_say(reason, "the ambient field is %.0f%% %s", fabs(share) * 100.0, share > 0.0 ? "stronger" : "weaker");
    }
    fmfts_say(reason, " since the baseline: a magnet or steel is near, which may look like a touch; where this is its place "
                      "for good, record the baseline again");
}

void fmfts_follow_foreign(fmfts_step *step)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_pose_memory *memory = step->memory;
    if (parameters->at_rest == 0.0 || !step->verdict.has_estimate) {
        return;
    }
    const fmfts_reference reference = fmfts_reference_beside(parameters, &step->felt);
    double faded_t = memory->foreign_t * FADES_S / (FADES_S + step->field.elapsed_s);
    memory->foreign_t = fmax(foreign_t(parameters, &reference, memory->state, &step->pose), faded_t);
    if (memory->native_frames < FMFTS_TRUSTED_FRAMES) {
        memory->native_frames = memory->foreign_t > 0.0 ? 0 : memory->native_frames + 1;
    }
    if (memory->foreign_t > parameters->strongest_foreign_t) {
        step->verdict.health = FMFTS_DISTURBED;
        step->verdict.has_estimate = false;
        say_why(&reference, memory->state + AMBIENT_VALUE, &step->verdict.reason);
        return;
    }
    fmfts_widen_by_foreign(parameters, memory, memory->state, &step->pose);
}

void fmfts_widen_by_foreign(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double *state,
                            fmfts_pose *pose)
{
    double added[5][5], square = memory->foreign_t * memory->foreign_t;
    if (memory->foreign_t == 0.0) {
        return;
    }
    for (int i = 0; i < 25; i++) {
        added[i / 5][i % 5] = square * parameters->unit_gradient[i];
    }
    fmfts_widen(parameters, state, (const double(*)[5])added, pose);
}
