/* What a foreign field that no residual shows leaves uncertain: hidden_gradient.py. */
#include <math.h>

#include "model.h"
#include "step.h"

/* The variance of what turns along with the pad. */
static double of_iron(const fmfts_pose_parameters *parameters, const fmfts_reference *reference, const double *direction)
{
    double square = 0.0, iron_t = parameters->iron_t[0];
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
    int errors = (int)parameters->ambient_errors[0];
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
    return parameters->even_t[0] * parameters->even_t[0] + of_frame + of_baseline + of_iron(parameters, reference, direction);
}

static double foreign_t(const fmfts_pose_parameters *parameters, const fmfts_reference *reference, const double *state,
                        const fmfts_pose *pose)
{
    double change[FMFTS_CHANGE], total[3], healthy = parameters->healthy_deviations[0];
    for (int i = 0; i < 3; i++) {
        total[i] = reference->field_t[i] + state[AMBIENT_VALUE + i];
    }
    double strength = sqrt(dot3(total, total)), strange = strength - reference->strength_t;
    if (!(fabs(strange) > healthy * parameters->even_t[0])) {
        return 0.0; /* also where the reference is not known */
    }
    fmfts_change(parameters, state, change);
    for (int i = 0; i < 3; i++) {
        change[5 + i] = state[AMBIENT_VALUE + i];
        total[i] /= strength;
    }
    double beyond = strange * strange - healthy * healthy * variance_along(parameters, reference, change, total, pose);
    return sqrt(fmax(beyond, 0.0));
}

bool fmfts_follow_foreign(const fmfts_pose_parameters *parameters, const fmfts_reference *reference, fmfts_pose_memory *memory,
                          fmfts_pose *pose)
{
    double fades_s = parameters->fades_s[0], faded_t = memory->foreign_t[0] * fades_s / (fades_s + pose->elapsed_s);
    memory->foreign_t[0] = fmax(foreign_t(parameters, reference, memory->state, pose), faded_t);
    if (memory->foreign_t[0] > parameters->strongest_foreign_t[0]) {
        return false;
    }
    fmfts_widen_by_foreign(parameters, memory, memory->state, pose);
    return true;
}

void fmfts_widen_by_foreign(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double *state,
                            fmfts_pose *pose)
{
    double added[5][5], square = memory->foreign_t[0] * memory->foreign_t[0];
    if (memory->foreign_t[0] == 0.0) {
        return;
    }
    for (int i = 0; i < 25; i++) {
        added[i / 5][i % 5] = square * parameters->unit_gradient[i];
    }
    fmfts_widen(parameters, state, (const double(*)[5])added, pose);
}
