/* Follows the magnet from frame to frame: solves each frame from the last good one, and gates it by χ². */
#include <string.h>

#include "model.h"
#include "tracking.h"

/* Misfit is averaged over so many frames: a fault shows within 40 ms, even before it is found, and the deviations of healthy
 * frames become half a per cent wider. */
static const double MISFIT_FRAMES = 8.0;

/* Moves the memory's state by a step [FMFTS_STEP]; the axis stays a unit vector. */
static void move(fmfts_pose_memory *memory, const double *step)
{
    double *state = memory->state, *axis = state + AXIS_VALUE, basis[2][3];
    tangent_basis(axis, basis);
    for (int i = 0; i < 3; i++) {
        state[i] += step[i];
        axis[i] += basis[0][i] * step[TILT_COLUMN] + basis[1][i] * step[TILT_COLUMN + 1];
    }
    double length = sqrt(dot3(axis, axis));
    for (int i = 0; i < 3; i++) {
        axis[i] /= length;
    }
    for (int c = LOG_COLUMN; c < FMFTS_STEP; c++) {
        state[LOG_VALUE + c - LOG_COLUMN] += step[c];
    }
}

/* Removes the unknown warming from the error of the moment, and from all that correlates with it: a Kalman update by a part of
 * the error that is now exactly known. */
static void learn_first_temperature(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, double warmer_k)
{
    double by_moment[FMFTS_STEP], step[FMFTS_STEP], variance = memory->covariance[(FMFTS_STEP + 1) * LOG_COLUMN];
    if (!(memory->unread_variance > 0.0)) {
        return;
    }
    for (int c = 0; c < FMFTS_STEP; c++) {
        by_moment[c] = memory->covariance[FMFTS_STEP * c + LOG_COLUMN] / variance;
        step[c] = by_moment[c] * (parameters->moment_per_k * warmer_k);
    }
    move(memory, step);
    for (int i = 0; i < FMFTS_STEP; i++) {
        for (int j = 0; j < FMFTS_STEP; j++) {
            memory->covariance[FMFTS_STEP * i + j] -= memory->unread_variance * (by_moment[i] * by_moment[j]);
        }
    }
    memory->unread_variance = 0.0;
}

/* The prior of this frame: the last good state at this temperature, widened by time and warming since then. */
static void predict(const fmfts_step *step, fmfts_prior *prior)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_pose_memory *memory = step->memory;
    double moment = memory->state[LOG_VALUE], warmer_k = step->temperature_c - parameters->rest_temperature_c;
    prior->warmth_variance = memory->warmth_variance;
    if (isfinite(warmer_k)) {
        double warmth = parameters->moment_per_k_deviation * warmer_k;
        learn_first_temperature(parameters, memory, warmer_k);
        prior->warmth_variance = fmax(warmth * warmth, memory->warmth_variance);
        if (parameters->part[LOG_COLUMN] == FMFTS_CONSIDERED) {
            moment = parameters->rest[LOG_VALUE] + parameters->moment_per_k * warmer_k;
        }
    }
    memcpy(prior->state, memory->state, sizeof prior->state);
    memcpy(prior->covariance, memory->covariance, sizeof prior->covariance);
    prior->state[LOG_VALUE] = moment;
    for (int c = 0; c < FMFTS_STEP; c++) {
        prior->covariance[(FMFTS_STEP + 1) * c] += parameters->walk_per_s[c] * memory->since_good_s;
    }
    prior->covariance[(FMFTS_STEP + 1) * LOG_COLUMN] += prior->warmth_variance - memory->warmth_variance;
}

unsigned fmfts_whole_sensors(const fmfts_pose_parameters *parameters, const double field_t[FMFTS_AXES])
{
    unsigned whole = 0;
    for (int sensor = 0; sensor < (int)parameters->sensors; sensor++) {
        const double *own = field_t + 3 * sensor;
        whole |= (unsigned)(isfinite(own[0]) && isfinite(own[1]) && isfinite(own[2])) << sensor;
    }
    return whole;
}

int fmfts_count(unsigned mask)
{
    int count = 0;
    for (; mask; mask &= mask - 1) {
        count++;
    }
    return count;
}

/* Leaves out the sensor that its mean residual blames, if enough others remain. */
static void leave_out_blamed(const fmfts_step *step, double field_t[FMFTS_AXES])
{
    int blamed = fmfts_blamed(step->memory);
    unsigned whole = fmfts_whole_sensors(step->parameters, field_t);
    if (blamed >= 0 && fmfts_count(whole & ~(1u << blamed)) >= FMFTS_FEWEST_SENSORS) {
        field_t[3 * blamed] = field_t[3 * blamed + 1] = field_t[3 * blamed + 2] = NAN;
    }
}

void fmfts_say_why_not(const fmfts_step *step, unsigned whole, fmfts_text *text)
{
    int blamed = fmfts_blamed(step->memory);
    const char *before = "";
    for (int sensor = 0; sensor < (int)step->parameters->sensors; sensor++) {
        if (whole >> sensor & 1) {
            continue;
        }
        fmfts_say(text, "%ssensor %d is ", before, sensor + 1);
        if (!fmfts_say_missing(&step->missing, sensor, text)) {
            fmfts_say(text, sensor == blamed ? "at odds with the others" : "without a new sample");
        }
        before = "; ";
    }
}

void fmfts_note_nearest(fmfts_step *step, const fmfts_solved *solved)
{
    step->nearest.known = true;
    memcpy(step->nearest.state, solved->state, sizeof solved->state);
    memcpy(step->nearest.placed, solved->placed, step->felt.count * sizeof solved->placed[0]);
}

/* The factor that widens the covariance. Residuals that exceed their deviations show an undetected error; the pose's
 * errors are then larger by the same factor. R. T. Birge, "The calculation of errors by the method of least squares",
 * Phys. Rev. 40 (1932) 207. */
static double misfit_of(const fmfts_step *step)
{
    double lasting = step->parameters->at_rest != 0.0 ? step->memory->lasting_misfit : 1.0;
    double own = step->misfit.known && fmfts_surprises(step) ? step->misfit.chi2 / step->misfit.freedom : 1.0;
    return fmax(fmax(step->memory->misfit, lasting), own);
}

void fmfts_accept(fmfts_step *step, const fmfts_prior *prior, const fmfts_solved *solved)
{
    fmfts_pose_memory *memory = step->memory;
    memory->misfit += (solved->chi2 / solved->freedom - memory->misfit) / MISFIT_FRAMES;
    memcpy(memory->state, solved->state, sizeof memory->state);
    memcpy(memory->covariance, solved->covariance, sizeof memory->covariance);
    memory->warmth_variance = prior->warmth_variance;
    memory->since_good_s = 0.0;
    memory->disturbed_frames = 0;
    memory->searched = FMFTS_NOT_SEARCHED; /* a later disturbance may have another cause */
    fmfts_note_nearest(step, solved);
    double misfit = misfit_of(step);
    for (int i = 0; i < FMFTS_STEP * FMFTS_STEP; i++) {
        step->pose.covariance[i] = misfit * solved->covariance[i];
    }
    step->pose.chi2 = solved->chi2;
    step->pose.residual_t = solved->residual_t;
    step->verdict.has_estimate = true;
}

/* Sets the verdict that holds as long as no pose is found. */
static void begin(fmfts_step *step, const double field_t[FMFTS_AXES])
{
    fmfts_verdict *verdict = &step->verdict;
    fmfts_clear(&verdict->reason);
    verdict->has_estimate = verdict->stronger = step->nearest.known = step->misfit.known = false;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        verdict->used[axis] = isfinite(field_t[axis]);
    }
    step->memory->since_good_s += fmax(step->field.elapsed_s, 0.0);
}

/* The ambient field is then as unknown as before a pad's first frame: pipeline/first_memory.py. */
#define UNSEEN_S 60.0

/* Solves the frame as a pad's first one, if no frame has shown yet that the field of the frames before was the Earth's. */
static bool begins_anew(fmfts_attempt *attempt, fmfts_prior *prior, fmfts_solved *solved)
{
    fmfts_step *step = attempt->step;
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_solved anew;
    if (parameters->at_rest == 0.0 || parameters->part[AMBIENT_COLUMN] != FMFTS_PRIOR ||
        step->memory->native_frames >= FMFTS_TRUSTED_FRAMES) {
        return false;
    }
    double since_good_s = step->memory->since_good_s;
    step->memory->since_good_s = fmax(since_good_s, UNSEEN_S);
    predict(step, prior);
    step->memory->since_good_s = since_good_s;
    fmfts_solve_frame(attempt, &anew);
    fmfts_misfit misfit = {true, anew.freedom, anew.chi2, 0.0};
    if (!fmfts_fits_steadily(parameters, &anew, &misfit)) {
        return false;
    }
    *solved = anew;
    step->misfit = misfit;
    step->memory->native_frames = 0;
    step->memory->foreign_t = 0.0;
    fmfts_clear(&step->verdict.reason);
    return true;
}

void fmfts_track(fmfts_step *step)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_verdict *verdict = &step->verdict;
    fmfts_prior prior;
    fmfts_solved solved;
    fmfts_attempt attempt = {.step = step, .prior = &prior};
    memcpy(attempt.field_t, step->field.field_t, sizeof attempt.field_t);
    leave_out_blamed(step, attempt.field_t);
    begin(step, attempt.field_t);
    unsigned whole = fmfts_whole_sensors(parameters, attempt.field_t), all = (1u << (int)parameters->sensors) - 1;
    if (fmfts_count(whole) < FMFTS_FEWEST_SENSORS) {
        verdict->health = FMFTS_LOST;
        fmfts_say_why_not(step, whole, &verdict->reason);
        fmfts_say(&verdict->reason, ": fewer than three sensors are left");
        return;
    }
    predict(step, &prior);
    fmfts_solve_frame(&attempt, &solved);
    fmfts_compare_moment(step, &solved);
    if (!fmfts_fits_steadily(parameters, &solved, &step->misfit)) {
        fmfts_explain(&attempt, &solved);
        if (verdict->has_estimate || !begins_anew(&attempt, &prior, &solved)) {
            return;
        }
    }
    fmfts_accept(step, &prior, &solved);
    verdict->health = whole == all ? FMFTS_OK : FMFTS_DEGRADED;
    if (whole != all) {
        fmfts_say_why_not(step, whole, &verdict->reason);
        fmfts_say(&verdict->reason, ": left out");
    }
}

void fmfts_doubt_beside_steel(fmfts_step *step)
{
    fmfts_verdict *verdict = &step->verdict;
    bool is_unused = false;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        is_unused |= isfinite(step->field.field_t[axis]) && !verdict->used[axis];
    }
    if (step->parameters->steel_nearby == 0.0 || verdict->health != FMFTS_DEGRADED || !is_unused) {
        return;
    }
    verdict->health = FMFTS_DISTURBED;
    verdict->has_estimate = false;
    fmfts_say(&verdict->reason,
              "; or steel or a magnet is near, as [pad.scene] says that it may be. If this stays without it, run selftest, and "
              "look at that sensor's wires");
}
