/* Averages the residual of each axis, and judges whether the sensors are healthy: residual_monitor.py, mean_residuals.py. */
#include <math.h>

#include "model.h"
#include "step.h"

/* The mean residuals of the axes that are there, as a least-squares problem, in units of their noise. jacobian: over the
 * unknowns; its last column is the mean. patterns: errors that healthy sensors have, one deviation each. */
typedef struct {
    int axes, unknowns, patterns;
    double jacobian[FMFTS_AXES][BASE_COLUMNS + 1];
    double pattern[FMFTS_AXES][1 + FMFTS_FIELD_ERRORS];
} mean_problem;

static void push_change(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory)
{
    double change[FMFTS_CHANGE], basis[2][3];
    tangent_basis(parameters->rest + AXIS_VALUE, basis);
    for (int i = 0; i < 3; i++) {
        change[i] = memory->state[i] - parameters->rest[i];
        change[5 + i] = memory->state[AMBIENT_VALUE + i];
    }
    change[3] = dot3(basis[0], memory->state + AXIS_VALUE);
    change[4] = dot3(basis[1], memory->state + AXIS_VALUE);
    memory->pushed[0] = fmin(memory->pushed[0] + 1.0, parameters->memory_frames[0]);
    memory->recent[0] += 1.0;
    for (int i = 0; i < FMFTS_CHANGE; i++) {
        memory->change[i] += (change[i] - memory->change[i]) / memory->pushed[0];
    }
}

/* Adds a frame's residuals. jacobian [axes]: receives the derivatives of the prediction by a step. */
static void push(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_field *field,
                 double jacobian[][FMFTS_STEP])
{
    const double magnet[FMFTS_MAGNET] = {parameters->strength_t_m3[0], parameters->octupole_m2[0]};
    fmfts_sources sources = {.count = 1, .log_moment = {NAN}};
    fmfts_sight sight[FMFTS_MAX_MAGNETS];
    place_sources(magnet, memory->state, &sources);
    for (int i = 0; i < (int)parameters->sensors[0]; i++) {
        const double *place = parameters->place_m + 3 * i;
        look_all(&sources, place, sight);
        for (int axis = 3 * i; axis < 3 * i + 3; axis++) {
            const double *direction = parameters->direction + 3 * axis;
            double predicted = sense_all(&sources, sight, memory->state, place, direction, false, jacobian[axis]);
            double *frames = &memory->frames[axis], *recent = &memory->recent_t[axis];
            double before = memory->recent[0] > 1.0 ? *recent : 0.0;
            *recent = before + (field->field_t[axis] - predicted - before) / memory->recent[0];
            if (isnan(field->field_t[axis])) {
                *frames = memory->mean_t[axis] = memory->lasting_t2[axis] = 0.0;
                continue;
            }
            *frames = fmin(*frames + 1.0, parameters->memory_frames[0]);
            memory->mean_t[axis] += (field->field_t[axis] - predicted - memory->mean_t[axis]) / *frames;
            memory->lasting_t2[axis] += (field->lasting_t2[axis] + field->other_t2[axis] - memory->lasting_t2[axis]) / *frames;
        }
    }
}

/* The error of an axis from one deviation of a cause: FieldErrors.at. */
static double error_of(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, int axes, int axis, int cause)
{
    int causes = (int)parameters->field_errors[0];
    double sum = 0.0, by_field = 0.0;
    for (int by = 0; by < 5; by++) {
        sum += memory->change[by] * parameters->by_pose[(by * axes + axis) * causes + cause];
    }
    for (int along = 0; along < 3; along++) {
        by_field += memory->change[5 + along] * parameters->by_field[(axis * 3 + along) * causes + cause];
    }
    return sum + by_field;
}

static void collect(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, double jacobian[][FMFTS_STEP],
                    mean_problem *p)
{
    double moment_deviation = sqrt(memory->covariance[LOG_COLUMN * FMFTS_STEP + LOG_COLUMN]);
    int axes = 3 * (int)parameters->sensors[0];
    p->axes = p->unknowns = 0;
    p->patterns = 1 + (int)parameters->field_errors[0];
    for (int axis = 0; axis < axes; axis++) {
        if (memory->frames[axis] == 0.0) {
            continue;
        }
        double *row = p->jacobian[p->axes], *pattern = p->pattern[p->axes];
        p->axes++;
        double frames = memory->frames[axis], memory_frames = parameters->memory_frames[0], noise = parameters->noise_t[axis];
        double effective = frames < memory_frames ? frames : 2.0 * memory_frames - 1.0;
        double weight = 1.0 / sqrt(noise * noise / effective + memory->lasting_t2[axis]);
        p->unknowns = 0;
        for (int c = 0; c < BASE_COLUMNS; c++) {
            if (parameters->part[c] == FMFTS_FREE || parameters->part[c] == FMFTS_PRIOR) {
                row[p->unknowns++] = weight * jacobian[axis][c];
            }
        }
        row[p->unknowns] = weight * memory->mean_t[axis];
        pattern[0] = weight * jacobian[axis][LOG_COLUMN] * moment_deviation;
        for (int cause = 1; cause < p->patterns; cause++) {
            pattern[cause] = weight * error_of(parameters, memory, axes, axis, cause - 1);
        }
    }
}

/* χ² of the mean beyond what the unknowns explain, for the covariance S = I + PPᵀ of noise and patterns P. Generalised
 * least squares gives the same as the projection on parity space in mean_residuals.py. False if the matrix is singular. */
static bool chi2_of(const mean_problem *p, double *chi2)
{
    fmfts_matrix normal, factored_normal;
    double spread[FMFTS_AXES][FMFTS_AXES], factored[FMFTS_AXES][FMFTS_AXES];
    double solved[BASE_COLUMNS + 1][FMFTS_AXES], step[BASE_COLUMNS + 1];
    size_t axes = (size_t)p->axes, last = (size_t)p->unknowns;
    for (size_t i = 0; i < axes; i++) {
        for (size_t j = i; j < axes; j++) {
            spread[i][j] = i == j;
            for (int k = 0; k < p->patterns; k++) {
                spread[i][j] += p->pattern[i][k] * p->pattern[j][k];
            }
        }
    }
    if (!factor_of_stride(FMFTS_AXES, axes, spread, 0.0, factored)) {
        return false;
    }
    for (size_t c = 0; c <= last; c++) {
        for (size_t i = 0; i < axes; i++) {
            solved[c][i] = p->jacobian[i][c];
        }
        solve_factored_of_stride(FMFTS_AXES, axes, factored, solved[c]);
        for (size_t r = 0; r <= c; r++) {
            normal[r][c] = 0.0;
            for (size_t i = 0; i < axes; i++) {
                normal[r][c] += p->jacobian[i][r] * solved[c][i];
            }
        }
    }
    if (!factor(last, normal, 0.0, factored_normal)) {
        return false;
    }
    for (size_t i = 0; i < last; i++) {
        step[i] = normal[i][last];
    }
    solve_factored(last, factored_normal, step);
    *chi2 = normal[last][last];
    for (size_t i = 0; i < last; i++) {
        *chi2 -= normal[i][last] * step[i];
    }
    return true;
}

bool fmfts_judge_residuals(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_field *field,
                           double slopes[][FMFTS_STEP])
{
    double chi2;
    mean_problem problem;
    int ready = 0, seen = 0, axes = 3 * (int)parameters->sensors[0];
    push_change(parameters, memory);
    push(parameters, memory, field, slopes);
    memory->since[0] += 1.0;
    if (fmod(memory->since[0], parameters->judged_every[0]) != 0.0) {
        return true;
    }
    if (memory->blamed[0] >= 0.0) {
        return false; /* Python looks whether the fault has ended */
    }
    memory->recent[0] = 0.0;
    for (int axis = 0; axis < axes; axis++) {
        memory->recent_t[axis] = 0.0;
        seen += memory->frames[axis] > 0.0;
        ready += memory->frames[axis] >= 2.0 * parameters->judged_every[0];
    }
    if (ready != 0 && ready < seen) {
        return false;
    }
    collect(parameters, memory, slopes, &problem);
    int freedom = ready - problem.unknowns;
    memory->lasting_misfit[0] = 1.0;
    if (freedom > 0) { /* else there are too few frames since a disturbance, or too few axes */
        if (!chi2_of(&problem, &chi2) || !(chi2 < parameters->alarm_chi2[freedom])) {
            return false;
        }
        memory->lasting_misfit[0] = fmax(chi2 / parameters->sound_chi2[freedom], 1.0);
        memory->sound[0] = chi2 < parameters->sound_chi2[freedom];
    }
    memory->was_sound[0] = fmax(memory->was_sound[0], memory->sound[0]);
    return true;
}
