/* Finds small faults that last: the mean residual of a quarter of a second shows what one frame's χ² does not.
 *
 * A residual z − h(x̂) is weighed by R (mean_residuals.h), for which R·J = 0: no pose can change it. So it does not depend on
 * the estimate, to first order, and a sensor that is left out is still judged. R is the square of a projection on parity
 * space: J. J. Gertler, "Survey of model-based failure detection and isolation", IEEE Control Systems 8 (1988) 3.
 */
#include "mean_residuals.h"

#include <string.h>

/* The mean forgets over so many frames (0.25 s at 220 Hz), and is judged once in so many. */
enum { MEMORY_FRAMES = 55, JUDGED_EVERY = 8 };

void fmfts_forget_means(fmfts_pose_memory *memory)
{
    memset(memory->mean_t, 0, sizeof memory->mean_t);
    memset(memory->frames, 0, sizeof memory->frames);
    memset(memory->recent_t, 0, sizeof memory->recent_t);
    memory->pushed = memory->recent = 0.0;
}

/* The mean change of pose and ambient field since rest, to which errors are proportional. */
static void push_change(const fmfts_step *step)
{
    fmfts_pose_memory *memory = step->memory;
    const double *state = step->nearest.state;
    double change[FMFTS_CHANGE];
    fmfts_change(step->parameters, state, change);
    memcpy(change + 5, state + AMBIENT_VALUE, 3 * sizeof(double));
    memory->pushed = fmin(memory->pushed + 1.0, MEMORY_FRAMES);
    for (int i = 0; i < FMFTS_CHANGE; i++) {
        memory->change[i] += (change[i] - memory->change[i]) / memory->pushed;
    }
}

bool fmfts_push_means(fmfts_step *step, const double *residual_t)
{
    fmfts_pose_memory *memory = step->memory;
    push_change(step);
    memory->recent += 1.0;
    memory->since += 1.0;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        double *frames = &memory->frames[axis], *recent = &memory->recent_t[axis];
        *recent += (residual_t[axis] - *recent) / memory->recent;
        if (isnan(residual_t[axis])) {
            *frames = memory->mean_t[axis] = memory->lasting_t2[axis] = 0.0;
            continue;
        }
        *frames = fmin(*frames + 1.0, MEMORY_FRAMES);
        memory->mean_t[axis] += (residual_t[axis] - memory->mean_t[axis]) / *frames;
        memory->lasting_t2[axis] += (step->field.other_t2[axis] - memory->lasting_t2[axis]) / *frames;
    }
    return fmod(memory->since, JUDGED_EVERY) == 0.0;
}

/* The errors of all axes from one deviation of a cause: FieldErrors.at. */
static void find_errors(const fmfts_field_errors *errors, size_t cause, const double change[FMFTS_CHANGE], double error[FMFTS_AXES])
{
    const size_t axes = errors->axes;
    const double *table = errors->table + cause * FMFTS_CHANGE * axes;
    for (size_t axis = 0; axis < axes; axis++) {
        double by_pose = 0.0, by_field = 0.0;
        for (size_t by = 0; by < 5; by++) {
            by_pose += change[by] * table[by * axes + axis];
        }
        for (size_t by = 5; by < FMFTS_CHANGE; by++) {
            by_field += change[by] * table[by * axes + axis];
        }
        error[axis] = by_pose + by_field;
    }
}

static void add_square(size_t axes, const double error[FMFTS_AXES], double common[][FMFTS_AXES])
{
    for (size_t i = 0; i < axes; i++) {
        for (size_t j = i; j < axes; j++) {
            common[i][j] += error[i] * error[j];
        }
    }
}

/* The covariance of the errors that all axes of healthy sensors have in common: that of the moment, and of what the baseline
 * leaves unknown. */
static void find_common(const fmfts_step *step, double common[][FMFTS_AXES])
{
    const fmfts_pose_memory *memory = step->memory;
    const size_t axes = 3 * (size_t)step->parameters->sensors;
    double moment_deviation = sqrt(memory->covariance[(FMFTS_STEP + 1) * LOG_COLUMN]), error[FMFTS_AXES];
    memset(common, 0, axes * sizeof common[0]);
    for (size_t axis = 0; axis < axes; axis++) {
        error[axis] = step->slopes[axis][LOG_COLUMN] * moment_deviation;
    }
    add_square(axes, error, common);
    for (size_t cause = 0; cause < step->errors.causes; cause++) {
        find_errors(&step->errors, cause, memory->change, error);
        add_square(axes, error, common);
    }
}

/* The axes of which own_t2 [axes], the variance of errors that no other axis has, is known. */
static void choose_axes(const fmfts_step *step, const double *own_t2, fmfts_judged_axes *judged)
{
    judged->axes = judged->unknowns = 0;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        if (isfinite(own_t2[axis])) {
            judged->axis[judged->axes++] = axis;
        }
    }
    for (int c = 0; c < FMFTS_STEP; c++) {
        if (step->parameters->part[c] == FMFTS_FREE || step->parameters->part[c] == FMFTS_PRIOR) {
            for (size_t i = 0; i < judged->axes; i++) {
                judged->jacobian[judged->unknowns][i] = step->slopes[judged->axis[i]][c];
            }
            judged->unknowns++;
        }
    }
}

static double along(size_t count, const double *a, const double *b)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* False if no redundancy is left, or these axes do not determine the unknowns. */
static bool solve_axes(const fmfts_step *step, double common[][FMFTS_AXES], const double *own_t2, fmfts_judged_axes *judged)
{
    double covariance[FMFTS_AXES][FMFTS_AXES];
    fmfts_matrix normal;
    choose_axes(step, own_t2, judged);
    for (size_t i = 0; i < judged->axes; i++) {
        for (size_t j = i; j < judged->axes; j++) {
            covariance[i][j] = common[judged->axis[i]][judged->axis[j]] + (i == j ? own_t2[judged->axis[i]] : 0.0);
        }
    }
    if (judged->axes <= judged->unknowns ||
        !factor_of_stride(FMFTS_AXES, judged->axes, covariance, 0.0, judged->covariance)) {
        return false;
    }
    for (size_t c = 0; c < judged->unknowns; c++) {
        memcpy(judged->solved[c], judged->jacobian[c], judged->axes * sizeof(double));
        solve_factored_of_stride(FMFTS_AXES, judged->axes, judged->covariance, judged->solved[c]);
        for (size_t r = 0; r <= c; r++) {
            normal[r][c] = along(judged->axes, judged->jacobian[r], judged->solved[c]);
        }
    }
    return factor(judged->unknowns, normal, 0.0, judged->normal);
}

void fmfts_weigh(fmfts_judged_axes *judged, const double *value, double *weighed)
{
    double unknown[FMFTS_STEP];
    for (size_t c = 0; c < judged->unknowns; c++) {
        unknown[c] = along(judged->axes, judged->solved[c], value);
    }
    solve_factored(judged->unknowns, judged->normal, unknown);
    memcpy(weighed, value, judged->axes * sizeof(double));
    solve_factored_of_stride(FMFTS_AXES, judged->axes, judged->covariance, weighed);
    for (size_t c = 0; c < judged->unknowns; c++) {
        for (size_t i = 0; i < judged->axes; i++) {
            weighed[i] -= judged->solved[c][i] * unknown[c];
        }
    }
}

/* χ² of what no unknown explains. value: of the pad's axes; own: receives those that are judged. */
static double chi2_of(fmfts_judged_axes *judged, const double *value, double own[FMFTS_AXES])
{
    double weighed[FMFTS_AXES];
    for (size_t i = 0; i < judged->axes; i++) {
        own[i] = value[judged->axis[i]];
    }
    fmfts_weigh(judged, own, weighed);
    return along(judged->axes, own, weighed);
}

/* Whether a fault ended: the last frames are healthy, although the mean still contains the fault. Otherwise a large
 * fault would outlive its cause by the seconds in which the mean forgets it. A few frames cannot show the end of a
 * small fault. */
static bool is_over(const fmfts_step *step, double common[][FMFTS_AXES], const double *recent_t)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    double own_t2[FMFTS_AXES], chosen[FMFTS_AXES];
    fmfts_judged_axes judged;
    for (int axis = 0; axis < 3 * (int)parameters->sensors; axis++) {
        double noise_t = parameters->noise_t[axis];
        own_t2[axis] = isfinite(recent_t[axis]) ? noise_t * noise_t / JUDGED_EVERY + step->memory->lasting_t2[axis] : NAN;
    }
    if (!solve_axes(step, common, own_t2, &judged)) {
        return false;
    }
    size_t freedom = judged.axes - judged.unknowns;
    return chi2_of(&judged, recent_t, chosen) < parameters->sound_chi2[freedom] &&
           chi2_of(&judged, step->memory->mean_t, chosen) > parameters->alarm_chi2[freedom];
}

/* The variance of the mean of each axis; NaN where there are too few frames. It is a mean of n frames; once the memory
 * is full, an exponential mean, which equals one of 2·memory − 1 frames. */
static void find_own(const fmfts_step *step, double *own_t2)
{
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        double frames = step->memory->frames[axis], noise_t = step->parameters->noise_t[axis];
        double effective = frames < MEMORY_FRAMES ? frames : 2.0 * MEMORY_FRAMES - 1.0;
        bool is_ready = frames >= 2 * JUDGED_EVERY;
        own_t2[axis] = is_ready ? noise_t * noise_t / effective + step->memory->lasting_t2[axis] : NAN;
    }
}

bool fmfts_explains_mean(const fmfts_step *step, double common[][FMFTS_AXES], const double *own_t2,
                         double added_t2)
{
    double other_t2[FMFTS_AXES], chosen[FMFTS_AXES];
    fmfts_judged_axes judged;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        other_t2[axis] = own_t2[axis] + added_t2;
    }
    return solve_axes(step, common, other_t2, &judged) &&
           chi2_of(&judged, step->memory->mean_t, chosen) < step->parameters->sound_chi2[judged.axes - judged.unknowns];
}

fmfts_finding fmfts_judge_means(fmfts_step *step)
{
    const fmfts_finding nothing = {.sensor = -1};
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_pose_memory *memory = step->memory;
    double common[FMFTS_AXES][FMFTS_AXES], own_t2[FMFTS_AXES], recent_t[FMFTS_AXES], mean_t[FMFTS_AXES];
    bool forgives = memory->found, has_recent = memory->recent == JUDGED_EVERY;
    fmfts_judged_axes judged;
    memcpy(recent_t, memory->recent_t, sizeof recent_t);
    memset(memory->recent_t, 0, sizeof memory->recent_t);
    memory->recent = 0.0;
    memory->lasting_misfit = 1.0;
    find_own(step, own_t2);
    find_common(step, common);
    if (!solve_axes(step, common, own_t2, &judged)) {
        return nothing;
    }
    size_t freedom = judged.axes - judged.unknowns;
    double chi2 = chi2_of(&judged, memory->mean_t, mean_t), sound_chi2 = parameters->sound_chi2[freedom];
    memory->sound = chi2 < sound_chi2;
    if (forgives && has_recent && is_over(step, common, recent_t)) {
        fmfts_forget_means(memory);
        return nothing;
    }
    if (chi2 < (forgives ? sound_chi2 : parameters->alarm_chi2[freedom])) {
        memory->lasting_misfit = fmax(chi2 / sound_chi2, 1.0);
        fmfts_drifts_less(step, common, own_t2);
        return nothing;
    }
    if (fmfts_drifts_further(step, common, own_t2)) {
        return nothing;
    }
    return fmfts_blame(step, &judged, mean_t);
}
