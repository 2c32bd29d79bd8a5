/* `now` of a pad with several magnets, while one finger presses or none: the equations are those of pose/motion.c and
 * contact/now.c, with the finger in place of the magnet's pose:
 *
 *     state: x, y (mm), force (N), two zeros; their rates; the change of the ambient field since the frame's instant
 *     z = h + J (x − x̂) + ambient along the axis
 *
 * x̂ is the finger that the frame's fit found, h what each axis most likely reads there without noise: including the
 * effects of shear, of a wide finger and of the baseline's errors, as far as the residual shows them (several/fit.c).
 * So the filter agrees with the fit. */
#include "finger.h"

#include <math.h>
#include <string.h>

#include "../arithmetic/descent.h"
#include "../pose/model.h"
#include "steps.h"

enum { NUMBERS = FMFTS_FINGER_NUMBERS, FORCE = 2, MOVED = FMFTS_MOVED, KNOWN = FMFTS_FOLLOWED, STATES = FMFTS_MOTION_STATES };

static const double UNIT[NUMBERS] = {1e-3, 1e-3, 1.0}; /* mm → m; newtons stay */

/* A new finger is followed from the previous frame on, in which its force was 0, if at most this much time lies
 * between. */
#define LONGEST_SINCE_UNTOUCHED_US 2e4

#define LONGEST_AHEAD_S 0.01
#define LIGHT_N 0.2 /* under a lighter finger less is known of what is wrong in proportion to the force */

bool fmfts_put_finger(const fmfts_fitter *fitter, fmfts_ahead *from, const double *covariance, int64_t time_us,
                      const fmfts_several_steps *steps, fmfts_followed_memory *memory)
{
    fmfts_finger_memory *finger = &memory->finger;
    const fmfts_motion_memory *motion = &memory->motion;
    /* Where no frame had a finger before, its own place is the best. */
    const bool is_followed = motion->motion_us > 0.0 && finger->untouched_us == 0.0;
    double there[NUMBERS];
    memcpy(there, is_followed ? motion->motion_state : from->finger, sizeof there);
    if (is_followed) {
        double ahead_s = fmfts_within(((double)time_us - motion->motion_us) * 1e-6, 0.0, LONGEST_AHEAD_S);
        there[FORCE] = fmax(there[FORCE] + ahead_s * motion->motion_state[FMFTS_RATE + FORCE], 0.0); /* its place's rates are poorly known */
    }
    if (!fmfts_finite(NUMBERS, there)) {
        return false;
    }
    from->there = is_followed ? there : NULL;
    from->light_n = LIGHT_N;
    memcpy(finger->finger, there, sizeof there);
    memcpy(finger->finger_covariance, covariance, sizeof finger->finger_covariance);
    steps->look_ahead(fitter->model, from, fitter->work, finger->ahead_t, finger->by_finger);
    from->there = NULL;
    return true;
}

static void look_at_finger(const fmfts_driven *driven, int sensor, const double *x, double ahead[3], double slope[3][KNOWN])
{
    const fmfts_finger_memory *finger = driven->finger;
    for (int k = 0; k < 3; k++) {
        int axis = 3 * sensor + k;
        const double *direction = driven->parameters->direction + 3 * axis;
        ahead[k] = finger->ahead_t[axis] + dot3(x + FMFTS_AMBIENT_CHANGE, direction);
        memset(slope[k], 0, sizeof slope[k]);
        memcpy(slope[k] + MOVED, direction, 3 * sizeof(double));
        for (int i = 0; i < NUMBERS; i++) {
            slope[k][i] = finger->by_finger[NUMBERS * axis + i];
            ahead[k] += slope[k][i] * (x[i] - finger->finger[i]);
        }
    }
}

/* W of motion.c: a finger accelerates in x, y and force alone. */
static void drive_of(const fmfts_now_parameters *parameters, double drive[MOVED * MOVED])
{
    memset(drive, 0, MOVED * MOVED * sizeof(double));
    for (int i = 0; i < NUMBERS; i++) {
        drive[(MOVED + 1) * i] = parameters->drive_power[i];
    }
}

static void begin(const fmfts_finger_memory *finger, const double *drive, fmfts_motion_memory *motion)
{
    double known[KNOWN] = {0.0}, covariance[KNOWN * KNOWN] = {0.0};
    double untouched_us = finger->places > 0.0 ? finger->untouched_us : finger->instant_us, since_us = finger->instant_us - untouched_us;
    bool was_untouched = untouched_us > 0.0 && since_us >= 0.0 && since_us < LONGEST_SINCE_UNTOUCHED_US;
    for (int i = 0; i < NUMBERS; i++) {
        known[i] = finger->finger[i];
        for (int k = 0; k < NUMBERS; k++) {
            covariance[KNOWN * i + k] = finger->finger_covariance[NUMBERS * i + k];
        }
    }
    if (was_untouched) {
        known[FORCE] = 0.0;
    }
    fmfts_begin_states(was_untouched ? untouched_us : finger->instant_us, known, covariance, drive, motion);
}

/* From now on the ambient field is the frame's; its change since then is not known yet. */
static void renew_ambient(fmfts_motion_memory *motion)
{
    for (int i = FMFTS_AMBIENT_CHANGE; i < FMFTS_AMBIENT_CHANGE + 3; i++) {
        motion->motion_state[i] = 0.0;
        for (int k = 0; k < STATES; k++) {
            motion->motion_covariance[STATES * i + k] = motion->motion_covariance[STATES * k + i] = 0.0;
        }
    }
}

/* The finger at time_us. */
static void tell(const fmfts_parameters *parameters, fmfts_followed_memory *memory, double time_us, fmfts_now *now)
{
    const fmfts_finger_memory *finger = &memory->finger;
    const fmfts_motion_memory *motion = &memory->motion;
    fmfts_contact_now *contact = &now->contact;
    bool pressed = finger->pressing > 0.0;
    double lead_s = (time_us - (pressed ? motion->motion_us : finger->instant_us)) * 1e-6, sum = 0.0, moving = 0.5;
    now->known = false;
    if (!(lead_s >= 0.0 && lead_s <= FMFTS_LONGEST_LEAD_S)) {
        return;
    }
    memory->now.told_us = time_us;
    contact->outputs = NUMBERS;
    for (int i = 0; i < NUMBERS; i++) {
        double own = UNIT[i] * finger->finger_deviation[i], variance = own * own, square = UNIT[i] * UNIT[i];
        contact->value[i] = contact->rate[i] = 0.0;
        contact->rate_deviation[i] = lead_s * parameters->now.drive_power[i] * square; /* first the variance */
        if (pressed) {
            const double *of_rate = motion->motion_covariance + STATES * (FMFTS_RATE + i) + FMFTS_RATE;
            moving = motion->modes[1];
            contact->value[i] = UNIT[i] * motion->motion_state[i];
            contact->rate[i] = UNIT[i] * motion->motion_state[FMFTS_RATE + i];
            contact->rate_deviation[i] = square * of_rate[i];
            variance += square * motion->motion_covariance[(STATES + 1) * i];
        }
        contact->deviation[i] = sqrt(variance);
    }
    fmfts_shrink(&parameters->now, moving, contact);
    fmfts_carry(lead_s, pressed && contact->value[FORCE] > 0.0, contact);
    for (int i = 0; i < NUMBERS; i++) {
        sum += contact->value[i] + contact->deviation[i] + contact->rate[i] + contact->rate_deviation[i];
    }
    now->known = isfinite(sum);
    now->places = pressed && finger->places > 0.0;
    now->time_us = time_us;
}

static fmfts_driven driven_by(const fmfts_parameters *parameters, const fmfts_pose_memory *newest,
                              const fmfts_finger_memory *finger, const double *drive)
{
    return (fmfts_driven){
        .parameters = &parameters->pose, .pose = newest, .drive = drive, .look = look_at_finger, .finger = finger};
}

void fmfts_follow_finger(const fmfts_parameters *parameters, fmfts_followed_memory *memory, const fmfts_finger_frame *frame,
                         fmfts_now *now)
{
    fmfts_finger_memory *finger = &memory->finger;
    size_t sensors = (size_t)parameters->pose.sensors;
    double drive[MOVED * MOVED], time_us = fmfts_publish_us(parameters, frame->sequence, frame->time_us, &memory->now);
    bool goes_on = finger->pressing == 0.0;
    memcpy(finger->taken_us, frame->sampled_us, sensors * sizeof(int64_t));
    now->known = false;
    if (finger->pressing > 0.0) {
        fmfts_pose_memory newest = {.newest_us = 0};
        for (int i = 0; i < NUMBERS; i++) {
            finger->finger_deviation[i] = sqrt(finger->finger_covariance[(NUMBERS + 1) * i]);
        }
        memcpy(newest.field_t, frame->field_t, 3 * sensors * sizeof(double));
        memcpy(newest.time_us, frame->sampled_us, sensors * sizeof(int64_t));
        drive_of(&parameters->now, drive);
        /* Where the newest samples had shown a finger before any frame did, its place was hardly known. */
        if (memory->motion.motion_us == 0.0 || finger->untouched_us > 0.0) {
            begin(finger, drive, &memory->motion);
        }
        renew_ambient(&memory->motion);
        fmfts_driven driven = driven_by(parameters, &newest, finger, drive);
        goes_on = fmfts_follow(&driven, &parameters->motion, frame->fresh, &memory->motion);
    } else {
        fmfts_forget_motion(&memory->motion);
    }
    finger->untouched_us = finger->pressing >= 0.0 && finger->places == 0.0 ? finger->instant_us : 0.0;
    if (goes_on) {
        tell(parameters, memory, time_us, now);
    } else {
        finger->pressing = -1.0; /* samples before the next frame have no `now` either */
    }
}

void fmfts_follow_finger_early(const fmfts_parameters *parameters, fmfts_followed_memory *memory, const fmfts_early *early,
                               fmfts_now *now)
{
    const fmfts_finger_memory *finger = &memory->finger;
    fmfts_pose_memory newest = {.newest_us = 0};
    double drive[MOVED * MOVED];
    memcpy(newest.time_us, finger->taken_us, sizeof finger->taken_us);
    now->known = false;
    if (!(parameters->now.early_lead_us > 0.0) || !(finger->pressing > 0.0) ||
        !fmfts_comes_next(&parameters->pose, newest.time_us, &memory->motion, early)) {
        return;
    }
    drive_of(&parameters->now, drive);
    fmfts_driven driven = driven_by(parameters, &newest, finger, drive);
    if (!fmfts_follow_early(&driven, &parameters->motion, early, &memory->motion)) {
        memory->finger.pressing = -1.0;
        return;
    }
    tell(parameters, memory, fmax((double)early->time_us + parameters->now.early_lead_us, memory->now.told_us), now);
}
