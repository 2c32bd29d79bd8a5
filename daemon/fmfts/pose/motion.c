/* The magnet's pose and its rate at the newest sample, from each chip's samples at their own times.
 *
 * tracker.c solves for the pose at the newest instant that all chips have passed, some 4 ms ago; a tap moves on in that time.
 * This filter predicts to each sample instead: an extended Kalman filter of two modes. The magnet is STILL (its rates die out)
 * or MOVING (its acceleration is white noise, along the directions in which presses move the magnet). After each frame the
 * modes are merged into one state, so that the memory is one state, its covariance and two probabilities (GPB1: Ackerson and
 * Fu, IEEE Trans. Automatic Control 15 (1970) 10; Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and
 * navigation" (2001), chapter 11).
 *
 * State x (13): change of the pose from rest (position in m, axis in the rest axis's tangent plane), its rates, and the change
 * of the ambient field since the baseline. Between samples, dt apart, with the drive W (5, 5) of MOVING:
 *
 *     pose += g·rate, rate *= e
 *     MOVING: e = 1, g = dt;  STILL: e: exponential of −dt/CALM_S, g = CALM_S·(1 − e)
 *     P += W·[dt³/3, dt²/2; dt²/2, dt]  (white acceleration: Bar-Shalom et al., chapter 6)
 *
 * Each axis of a sample is one scalar measurement z = field + ambient along the axis, with h its derivative by x:
 *
 *     s = hPhᵀ + r,  ν = z − ẑ,  x += Phᵀν/s,  P −= Phᵀ(Phᵀ)ᵀ/s,  mode's log likelihood −= (ν²/s + ln(s/r))/2
 */
#include <math.h>
#include <string.h>

#include "model.h"
#include "motion_modes.h"

/* Factor of the covariance of the solver's pose, with which the filter begins: that pose shares samples with the next
 * frame. */
#define FIRST_COVARIANCE 4.0
/* The variance of the first rates is what the drive adds in this time. */
#define FIRST_RATE_S 0.02
/* Boards read chips by turns, so that samples of two chips may come in the wrong order; older ones are not used. */
#define LATE_US 1000.0

enum { N = FMFTS_MOTION_STATES, RATE = FMFTS_RATE, AMBIENT = FMFTS_AMBIENT_CHANGE, MODES = FMFTS_MODES };
enum { KNOWN = FMFTS_FOLLOWED }; /* states that the solver knows: pose and ambient field */

void fmfts_forget_motion(fmfts_motion_memory *memory)
{
    memory->motion_us = 0.0;
}

void fmfts_begin_states(double time_us, const double *known, const double *covariance, const double *drive,
                        fmfts_motion_memory *memory)
{
    static const int STATE_OF[KNOWN] = {0, 1, 2, 3, 4, AMBIENT, AMBIENT + 1, AMBIENT + 2};
    memset(memory->motion_state, 0, sizeof memory->motion_state);
    memset(memory->motion_covariance, 0, sizeof memory->motion_covariance);
    memset(memory->early_us, 0, sizeof memory->early_us);
    memory->motion_us = time_us;
    memory->followed = 0.0;
    for (int i = 0; i < KNOWN; i++) {
        memory->motion_state[STATE_OF[i]] = known[i];
        for (int k = 0; k < KNOWN; k++) {
            memory->motion_covariance[N * STATE_OF[i] + STATE_OF[k]] = FIRST_COVARIANCE * covariance[KNOWN * i + k];
        }
    }
    for (int i = 0; i < RATE; i++) {
        for (int k = 0; k < RATE; k++) {
            memory->motion_covariance[N * (RATE + i) + RATE + k] = FIRST_RATE_S * drive[RATE * i + k];
        }
    }
    for (int m = 0; m < MODES; m++) {
        memory->modes[m] = 1.0 / MODES;
    }
}

void fmfts_begin_motion(const fmfts_step *step, const double *drive, fmfts_motion_memory *memory)
{
    static const int COLUMN_OF[KNOWN] = {0, 1, 2, 3, 4, AMBIENT_COLUMN, AMBIENT_COLUMN + 1, AMBIENT_COLUMN + 2};
    double known[KNOWN], covariance[KNOWN * KNOWN];
    fmfts_change(step->parameters, step->memory->state, known);
    memcpy(known + RATE, step->memory->state + AMBIENT_VALUE, 3 * sizeof(double));
    for (int i = 0; i < KNOWN; i++) {
        for (int k = 0; k < KNOWN; k++) {
            covariance[KNOWN * i + k] = step->pose.covariance[FMFTS_STEP * COLUMN_OF[i] + COLUMN_OF[k]];
        }
    }
    fmfts_begin_states((double)step->field.instant_us, known, covariance, drive, memory);
}

static bool had_early(const fmfts_motion_memory *memory)
{
    for (int i = 0; i < FMFTS_SENSORS; i++) {
        if (memory->early_us[i] != 0.0) {
            return true;
        }
    }
    return false;
}

/* The modes since the last frame: from the samples that came before their frame, or else from the merged state. shares:
 * their probabilities after that frame. Returns the time of its newest sample. */
static double begin_modes(const fmfts_motion_memory *memory, fmfts_mode modes[MODES], double shares[MODES])
{
    bool goes_on = had_early(memory);
    for (int m = 0; m < MODES; m++) {
        const double *x = goes_on ? memory->early_state + N * m : memory->motion_state;
        memcpy(modes[m].x, x, sizeof modes[m].x);
        memcpy(modes[m].p, goes_on ? memory->early_covariance + N * N * m : memory->motion_covariance, sizeof modes[m].p);
        modes[m].chi2 = goes_on ? memory->early_chi2_sum[m] : 0.0;
        modes[m].widths = goes_on ? memory->early_widths[m] : 1.0;
        shares[m] = goes_on ? memory->early_modes[m] : memory->modes[m];
    }
    return goes_on ? memory->early_from_us : memory->motion_us;
}

/* Whether the best mode's innovations are those of a healthy pad. before: its sum before this frame. */
static bool is_sound(const fmfts_mode modes[MODES], const double *before, double most)
{
    double chi2 = INFINITY;
    for (int m = 0; m < MODES; m++) {
        chi2 = fmin(chi2, modes[m].chi2 - before[m]);
    }
    return chi2 < most;
}

bool fmfts_is_next(const fmfts_motion_memory *memory, int sensor, double time_us)
{
    return memory->motion_us > 0.0 && time_us > fmax(memory->early_us[sensor], memory->motion_us - LATE_US);
}

/* The sensors (mask) whose samples are taken with their frame. */
static unsigned left_of(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *pose, unsigned fresh,
                        const fmfts_motion_memory *memory)
{
    unsigned left = 0;
    bool early = had_early(memory);
    for (int i = 0; i < (int)parameters->sensors; i++) {
        bool is_left = (fresh >> i & 1) && (!early || fmfts_is_next(memory, i, (double)pose->time_us[i]));
        left |= (unsigned)is_left << i;
    }
    return left;
}

static int oldest_of(const fmfts_pose_memory *pose, unsigned left)
{
    int oldest = -1;
    for (int i = 0; i < FMFTS_SENSORS; i++) {
        oldest = (left >> i & 1) && (oldest < 0 || pose->time_us[i] < pose->time_us[oldest]) ? i : oldest;
    }
    return oldest;
}

/* Whether all samples are older than those that came before their frame: an old frame, sent again. */
static bool is_old(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *pose, const fmfts_motion_memory *memory)
{
    for (int i = 0; i < (int)parameters->sensors; i++) {
        if ((double)pose->time_us[i] > memory->motion_us - LATE_US) {
            return false;
        }
    }
    return had_early(memory);
}

bool fmfts_follow(const fmfts_driven *driven, const fmfts_motion_parameters *own, unsigned fresh, fmfts_motion_memory *memory)
{
    const fmfts_pose_parameters *parameters = driven->parameters;
    const fmfts_pose_memory *pose = driven->pose;
    const double none[MODES] = {0.0};
    fmfts_mode modes[MODES];
    double shares[MODES], newest_us = memory->motion_us;
    unsigned left = left_of(parameters, pose, fresh, memory);
    if (is_old(parameters, pose, memory)) {
        fmfts_forget_motion(memory);
        return false;
    }
    if (!left && !had_early(memory)) {
        return true;
    }
    double from_us = begin_modes(memory, modes, shares);
    while (left) {
        fmfts_early sample = {.sensor = oldest_of(pose, left)};
        left &= ~(1u << sample.sensor);
        sample.time_us = pose->time_us[sample.sensor];
        newest_us = (double)sample.time_us;
        memcpy(sample.field_t, pose->field_t + 3 * sample.sensor, sizeof sample.field_t);
        if (!fmfts_take_sample(driven, &sample, modes, memory)) {
            fmfts_forget_motion(memory);
            return false;
        }
    }
    fmfts_merge(own, fmax(newest_us - from_us, 0.0) * 1e-6, modes, shares, memory);
    memory->followed += 1.0;
    memset(memory->early_us, 0, sizeof memory->early_us);
    if (!is_sound(modes, none, own->surprise_chi2) || !fmfts_is_upright(memory->motion_state)) {
        fmfts_forget_motion(memory);
        return false;
    }
    return true;
}

/* The modes until the next sample that comes before its frame. */
static void keep_modes(const fmfts_mode modes[MODES], fmfts_motion_memory *memory)
{
    for (int m = 0; m < MODES; m++) {
        memcpy(memory->early_state + N * m, modes[m].x, sizeof modes[m].x);
        memcpy(memory->early_covariance + N * N * m, modes[m].p, sizeof modes[m].p);
        memory->early_chi2_sum[m] = modes[m].chi2;
        memory->early_widths[m] = modes[m].widths;
    }
}

bool fmfts_follow_early(const fmfts_driven *driven, const fmfts_motion_parameters *own, const fmfts_early *early,
                        fmfts_motion_memory *memory)
{
    const double none[MODES] = {0.0};
    fmfts_mode modes[MODES];
    double shares[MODES], before[MODES], from_us = begin_modes(memory, modes, shares);
    for (int m = 0; m < MODES; m++) {
        before[m] = modes[m].chi2;
    }
    if (!fmfts_take_sample(driven, early, modes, memory)) {
        fmfts_forget_motion(memory);
        return false;
    }
    fmfts_merge(own, fmax((double)early->time_us - from_us, 0.0) * 1e-6, modes, shares, memory);
    keep_modes(modes, memory);
    memory->early_us[early->sensor] = (double)early->time_us;
    memory->early_from_us = from_us;
    memcpy(memory->early_modes, shares, sizeof shares);
    if (!is_sound(modes, before, own->early_chi2) || !is_sound(modes, none, own->surprise_chi2) ||
        !fmfts_is_upright(memory->motion_state)) {
        fmfts_forget_motion(memory);
        return false;
    }
    return true;
}
