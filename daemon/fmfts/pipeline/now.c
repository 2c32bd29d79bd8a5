/* `now` of a message: the contact at the time of publishing, by the filter of pose/motion.c and contact/now.c. The time comes from
 * the frame's number and the board's clock alone, never from arrivals, so that a replay says the same. */
#include <math.h>
#include <string.h>

#include "../pose/model.h"
#include "../pose/push.h"
#include "steps.h"

enum { CONTACT = FMFTS_MAX_OUTPUTS, POSE = FMFTS_POSE, STATES = FMFTS_MOTION_STATES, MOVING = 1 };

#define MM_PER_M 1e3
static const double UNIT[CONTACT] = {1e-3, 1e-3, 1.0, 1.0, 1.0}; /* mm → m; newtons stay */

/* Number of frames after which the filter has settled. */
enum { SETTLED_FRAMES = 3 };
/* At the earliest a frame is made just after its newest conversion, so the latest of the recent frames gives the time.
 * This bound is relaxed by this share of a period each frame, to follow a board with another rate than its nominal one.
 * */
#define LET_GO 0.0025
#define JUMP_PERIODS 2.5 /* the board was reset */

double fmfts_publish_us(const fmfts_parameters *parameters, int64_t sequence, int64_t frame_us, fmfts_now_memory *memory)
{
    double period_us = parameters->pose.period_us, made_since_us = (double)sequence * period_us;
    double first_us = (double)frame_us - made_since_us;
    double made_us = fmax(memory->made_us - LET_GO * period_us, first_us);
    if (made_us - first_us > JUMP_PERIODS * period_us) {
        made_us = first_us;
    }
    memory->made_us = made_us;
    return made_us + made_since_us + parameters->now.lead_us;
}

/* The filter's pose in the form of the solver's. The uncertainty through the moment is the solver's. */
static void at_newest(const fmfts_pose_parameters *parameters, const fmfts_motion_memory *memory, const double *moment,
                      double *state, fmfts_pose *pose)
{
    double turn[2][3], moment_variance = moment[FMFTS_MOVED];
    fmfts_pose_after(parameters, memory->motion_state, state, state + AXIS_VALUE, turn);
    memcpy(state + AMBIENT_VALUE, memory->motion_state + FMFTS_AMBIENT_CHANGE, 3 * sizeof(double));
    for (int i = 0; i < 5; i++) {
        for (int k = 0; k < 5; k++) {
            double *own = &pose->covariance[FMFTS_STEP * i + k];
            *own = memory->motion_covariance[STATES * i + k];
            if (moment_variance > 0.0) {
                *own += moment[i] * moment[k] / moment_variance;
            }
        }
    }
}

/* The contact's rates from those of the pose, with their variances. */
static void rates(const fmfts_pose_parameters *parameters, const fmfts_motion_memory *memory,
                  const fmfts_displacement *displacement, const double *by_pose, fmfts_contact_now *now)
{
    double spread[POSE][5] = {{0}};
    for (int i = 0; i < 3; i++) {
        const double *turn = parameters->drawn_turn + 3 * i;
        for (int k = 0; k < 3; k++) {
            spread[i][k] = parameters->pad_turn[3 * i + k] * MM_PER_M;
        }
        spread[3 + i][3] = dot3(turn, displacement->basis[0]);
        spread[3 + i][4] = dot3(turn, displacement->basis[1]);
    }
    for (int c = 0; c < now->outputs; c++) {
        double slope[5], variance = 0.0;
        now->rate[c] = 0.0;
        for (int k = 0; k < 5; k++) {
            slope[k] = 0.0;
            for (int i = 0; i < POSE; i++) {
                slope[k] += UNIT[c] * by_pose[POSE * c + i] * spread[i][k];
            }
            now->rate[c] += slope[k] * memory->motion_state[FMFTS_RATE + k];
        }
        for (int k = 0; k < 5; k++) {
            const double *row = memory->motion_covariance + STATES * (FMFTS_RATE + k) + FMFTS_RATE;
            for (int l = 0; l < 5; l++) {
                variance += slope[k] * row[l] * slope[l];
            }
        }
        now->rate_deviation[c] = variance;
    }
}

static bool is_finite(const fmfts_contact_now *now)
{
    double sum = 0.0;
    for (int i = 0; i < now->outputs; i++) {
        sum += now->value[i] + now->deviation[i] + now->rate[i] + now->rate_deviation[i];
    }
    return isfinite(sum);
}

static bool has_covariance(const fmfts_motion_memory *memory)
{
    for (int i = 0; i < STATES; i++) {
        if (!(memory->motion_covariance[(STATES + 1) * i] >= 0.0)) {
            return false;
        }
    }
    return true;
}

/* The filter's change of pose from rest, and the contact model's answer. False if there is none. */
static bool ask(const fmfts_pad *pad, const fmfts_memory *memory, const fmfts_judged *judged, fmfts_displacement *displacement,
                fmfts_estimate *estimate)
{
    const fmfts_parameters *parameters = pad->parameters;
    double state[FMFTS_STATE];
    fmfts_pose pose = {.chi2 = 0.0};
    fmfts_question question;
    memcpy(state, memory->pose.state, sizeof state);
    at_newest(&parameters->pose, &memory->motion, judged->moment, state, &pose);
    fmfts_widen_by_foreign(&parameters->pose, &memory->pose, state, &pose);
    fmfts_displace(&parameters->pose, &memory->pose, state, &pose, NULL, displacement);
    fmfts_draw(&parameters->pose, state, displacement, MM_PER_M, question.pose, question.covariance);
    fmfts_keep_inside(&parameters->contact, &question);
    return fmfts_estimate_contact(&parameters->contact, &question, &pad->network, pad->response, pad->response_bytes,
                                  estimate);
}

/* No finger lifts the magnet. Near rest, noise and what the baseline leaves unknown look like corner presses. In a
 * contact, message and `now` agree about it. */
static bool is_pressed(const fmfts_pad *pad, const fmfts_memory *memory, const fmfts_displacement *displacement,
                       const fmfts_estimate *estimate)
{
    double chi2;
    bool is_certain = fmfts_is_published(&memory->contact) || estimate->doubt < 1.0;
    bool has_moved = memory->contact.in_contact == FMFTS_RECENT_PRESS || /* recent_rest.c: the change since the baseline hides it */
                     (fmfts_chi2_from_rest(FMFTS_MOVED, displacement->change, displacement->at_rest, &chi2) &&
                      chi2 > pad->parameters->contact.release_chi2);
    return memory->motion.motion_state[2] < 0.0 && is_certain && has_moved;
}

/* The contact at time_us, into `now`; not known if the filter or the model does not give it. False if a model that is an
 * object answers no number: it has raised. */
static bool tell(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_judged *judged, double time_us, fmfts_now *now)
{
    const fmfts_parameters *parameters = pad->parameters;
    fmfts_contact_now *contact = &now->contact;
    bool touching = fmfts_is_published(&memory->contact);
    double lead_s = (time_us - memory->motion.motion_us) * 1e-6;
    fmfts_displacement displacement;
    fmfts_estimate estimate;
    now->known = false;
    if (judged->over_range || memory->motion.followed < SETTLED_FRAMES || !(lead_s >= 0.0 && lead_s <= FMFTS_LONGEST_LEAD_S)) {
        return true;
    }
    memory->now.told_us = time_us;
    if (!has_covariance(&memory->motion)) {
        return true;
    }
    bool is_answered = ask(pad, memory, judged, &displacement, &estimate) && !isnan(estimate.place[2]);
    if (!is_answered || (touching && (estimate.over_range || estimate.refused))) {
        return is_answered || !pad->network.evaluate;
    }
    contact->outputs = estimate.outputs;
    memcpy(contact->value, estimate.place, sizeof contact->value);
    memcpy(contact->deviation, estimate.deviation, sizeof contact->deviation);
    contact->deviation[2] = fmfts_force_sd_n(&parameters->message, &estimate, &memory->contact);
    rates(&parameters->pose, &memory->motion, &displacement, estimate.by_pose, contact);
    fmfts_shrink(&parameters->now, memory->motion.modes[MOVING], contact);
    fmfts_carry(lead_s, is_pressed(pad, memory, &displacement, &estimate), contact);
    now->known = is_finite(contact);
    now->places = touching;
    now->time_us = time_us;
    return true;
}

/* Gives the frame's samples to the filter. False if they contradict the prediction. */
static bool follow(const fmfts_pad *pad, fmfts_frame_work *work, unsigned fresh, fmfts_judged *judged)
{
    const fmfts_parameters *parameters = pad->parameters;
    fmfts_memory *memory = work->memory;
    const fmfts_step *step = &work->step;
    bool touching = fmfts_is_published(&memory->contact);
    if (!fmfts_drive(&parameters->now, pad->response, pad->response_bytes, touching ? &work->estimate : NULL, judged->drive)) {
        return false;
    }
    if (memory->motion.motion_us == 0.0) {
        fmfts_begin_motion(step, judged->drive, &memory->motion);
    }
    const fmfts_driven driven = fmfts_driven_magnet(&parameters->pose, &memory->pose, judged->drive);
    if (!fmfts_follow(&driven, &parameters->motion, fresh, &memory->motion)) {
        return false;
    }
    for (int i = 0; i < FMFTS_MOVED; i++) {
        judged->moment[i] = step->pose.covariance[FMFTS_STEP * i + LOG_COLUMN];
    }
    judged->moment[FMFTS_MOVED] = step->pose.covariance[(FMFTS_STEP + 1) * LOG_COLUMN];
    judged->over_range = touching && (work->estimate.over_range || work->estimate.refused);
    return true;
}

bool fmfts_find_now(const fmfts_pad *pad, const fmfts_frame *frame, fmfts_frame_work *work, fmfts_reading *reading)
{
    const fmfts_parameters *parameters = pad->parameters;
    fmfts_memory *memory = work->memory;
    bool is_healthy = work->step.verdict.health == FMFTS_OK && parameters->pose.neighbours == 0.0 &&
                      !pad->hand.state;
    if (parameters->now.tells_now == 0.0) {
        return true;
    }
    if (!is_healthy || !work->has_estimate || !work->touch_is_known) {
        fmfts_forget_motion(&memory->motion);
        return true;
    }
    double time_us = fmfts_publish_us(parameters, frame->sequence, frame->time_us, &memory->now);
    reading->judged.known = follow(pad, work, frame->fresh, &reading->judged);
    return !reading->judged.known || tell(pad, memory, &reading->judged, time_us, &reading->now);
}

void fmfts_read_early(const fmfts_pose_parameters *parameters, unsigned gain_code, const int16_t counts[3], double field_t[3])
{
    for (int axis = 0; axis < 3; axis++) {
        field_t[axis] = gain_code < FMFTS_GAIN_CODES ? fmfts_field_of_count(parameters, gain_code, axis, counts[axis]) : NAN;
    }
}

bool fmfts_is_new(const fmfts_pose_parameters *parameters, const int64_t *taken_us, const fmfts_early *early)
{
    double sum = early->field_t[0] + early->field_t[1] + early->field_t[2];
    if (early->sensor < 0 || early->sensor >= (int)parameters->sensors || !isfinite(sum)) {
        return false;
    }
    int64_t ahead_us = early->time_us - fmfts_latest((size_t)parameters->sensors, taken_us);
    return early->time_us > taken_us[early->sensor] && (double)ahead_us <= FMFTS_LONGEST_LEAD_S * 1e6;
}

bool fmfts_comes_next(const fmfts_pose_parameters *parameters, const int64_t *taken_us, const fmfts_motion_memory *memory,
                      const fmfts_early *early)
{
    return fmfts_is_new(parameters, taken_us, early) && fmfts_is_next(memory, early->sensor, (double)early->time_us);
}

bool fmfts_take_early(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_early *early, fmfts_reading *reading)
{
    const fmfts_parameters *parameters = pad->parameters;
    fmfts_judged *judged = &reading->judged;
    if (!(parameters->now.early_lead_us > 0.0) || !judged->known ||
        !fmfts_comes_next(&parameters->pose, memory->pose.time_us, &memory->motion, early)) {
        return false;
    }
    const fmfts_driven driven = fmfts_driven_magnet(&parameters->pose, &memory->pose, judged->drive);
    if (!fmfts_follow_early(&driven, &parameters->motion, early, &memory->motion)) {
        fmfts_forget_motion(&memory->motion);
        judged->known = false;
        return false;
    }
    double time_us = fmax((double)early->time_us + parameters->now.early_lead_us, memory->now.told_us);
    fmfts_now now;
    tell(pad, memory, judged, time_us, &now);
    if (now.known) {
        reading->now = now;
    }
    return now.known;
}
