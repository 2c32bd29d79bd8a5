/* `now` of a healthy frame's message: NowEstimator.update. */
#include <math.h>
#include <string.h>

#include "../../pose/model.h"
#include "frame_step.h"

enum { CONTACT = FMFTS_CONTACT, POSE = FMFTS_POSE, STATES = FMFTS_MOTION_STATES, MOVING = 1 };

#define MM_PER_M 1e3
static const double UNIT[CONTACT] = {1e-3, 1e-3, 1.0, 1.0, 1.0}; /* mm → m; newtons stay */

/* NowEstimator._publish_us */
static double publish_us(const fmfts_now_parameters *parameters, const fmfts_frame *frame, fmfts_now_memory *memory)
{
    double period_us = parameters->period_us[0], first_us = frame->time_us - frame->sequence * period_us;
    double made_us = fmax(memory->made_us[0] - parameters->let_go[0] * period_us, first_us);
    if (made_us - first_us > parameters->jump_periods[0] * period_us) {
        made_us = first_us;
    }
    memory->made_us[0] = made_us;
    return made_us + frame->sequence * period_us + parameters->lead_us[0];
}

/* NowEstimator._at_newest: the filter's pose in the form of the solver's. */
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
        spread[i][i] = MM_PER_M;
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

static void put_now(const fmfts_contact_now *now, fmfts_numbers *n)
{
    double *x[4] = {n->now_x_m, n->now_x_sd_m, n->now_x_rate_m_per_s, n->now_x_rate_sd_m_per_s};
    double *y[4] = {n->now_y_m, n->now_y_sd_m, n->now_y_rate_m_per_s, n->now_y_rate_sd_m_per_s};
    double *force[4] = {n->now_force_n, n->now_force_sd_n, n->now_force_rate_n_per_s, n->now_force_rate_sd_n_per_s};
    double *shear_x[4] = {n->now_shear_x_n, n->now_shear_x_sd_n, n->now_shear_x_rate_n_per_s, n->now_shear_x_rate_sd_n_per_s};
    double *shear_y[4] = {n->now_shear_y_n, n->now_shear_y_sd_n, n->now_shear_y_rate_n_per_s, n->now_shear_y_rate_sd_n_per_s};
    const double *from[4] = {now->value, now->deviation, now->rate, now->rate_deviation};
    for (int i = 0; i < 4; i++) {
        *x[i] = from[i][0];
        *y[i] = from[i][1];
        *force[i] = from[i][2];
        *shear_x[i] = now->outputs > 3 ? from[i][3] : 0.0;
        *shear_y[i] = now->outputs > 3 ? from[i][4] : 0.0;
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

/* NowEstimator._told: the contact at time_us. False if it is not known. */
static bool tell(const fmfts_pad *pad, fmfts_memory *memory, double time_us, fmfts_outcome *outcome)
{
    const fmfts_parameters *parameters = pad->parameters;
    const fmfts_now_parameters *own = &parameters->now;
    const fmfts_judged *judged = &outcome->judged;
    bool touching = memory->contact.in_contact[0] != 0.0;
    double chi2, state[FMFTS_STATE], lead_s = (time_us - memory->motion.motion_us[0]) * 1e-6;
    fmfts_pose pose = {.chi2 = 0.0};
    fmfts_displacement displacement;
    fmfts_question question;
    fmfts_estimate estimate;
    fmfts_contact_now now;
    if (memory->motion.followed[0] < own->settled_frames[0] || !(lead_s >= 0.0 && lead_s <= own->longest_lead_s[0])) {
        return false;
    }
    if (!judged->over_range) {
        memory->now.told_us[0] = time_us;
    }
    for (int i = 0; i < STATES; i++) {
        if (!(memory->motion.motion_covariance[(STATES + 1) * i] >= 0.0)) {
            return false;
        }
    }
    memcpy(state, memory->pose.state, sizeof state);
    at_newest(&parameters->pose, &memory->motion, judged->moment, state, &pose);
    fmfts_widen_by_foreign(&parameters->pose, &memory->pose, state, &pose);
    fmfts_displace(&parameters->pose, &memory->pose, state, &pose, NULL, &displacement);
    fmfts_draw(&parameters->pose, state, &displacement, MM_PER_M, question.pose, question.covariance);
    if (!fmfts_chi2_from_rest(displacement.change, displacement.at_rest, &chi2) ||
        !fmfts_keep_inside(&parameters->contact, &question) ||
        !fmfts_estimate_contact(&parameters->contact, &question, &pad->network,
                                parameters->contact.refine_steps[0] > 0.0 ? pad->response : NULL, pad->response_bytes,
                                &estimate)) {
        return false;
    }
    if (touching && (estimate.refused || (estimate.over_range && !judged->over_range))) {
        return false; /* not known, which only Python says */
    }
    now.outputs = estimate.outputs;
    memcpy(now.value, estimate.place, sizeof now.value);
    memcpy(now.deviation, estimate.deviation, sizeof now.deviation);
    now.deviation[2] = fmfts_force_sd_n(&parameters->message, &estimate, &memory->contact);
    rates(&parameters->pose, &memory->motion, &displacement, estimate.by_pose, &now);
    fmfts_shrink(own, memory->motion.modes[MOVING], &now);
    bool is_certain = touching || estimate.doubt < 1.0;
    bool pressed = memory->motion.motion_state[2] < 0.0 && chi2 > parameters->contact.release_chi2[0] && is_certain;
    fmfts_carry(own, lead_s, pressed, &now);
    if (!is_finite(&now)) {
        return false;
    }
    outcome->now_us = time_us;
    put_now(&now, &outcome->numbers);
    return true;
}

bool fmfts_tell_now(const fmfts_pad *pad, fmfts_memory *next, const fmfts_frame *frame, const fmfts_pose *solved,
                    const fmfts_estimate *last, fmfts_outcome *outcome)
{
    const fmfts_parameters *parameters = pad->parameters;
    fmfts_judged *judged = &outcome->judged;
    bool touching = next->contact.in_contact[0] != 0.0;
    double time_us = publish_us(&parameters->now, frame, &next->now);
    if (!fmfts_drive(&parameters->now, pad->response, pad->response_bytes, touching ? last : NULL, judged->drive) ||
        !fmfts_follow(&parameters->pose, &parameters->motion, &next->pose, frame->fresh, judged->drive, &next->motion)) {
        return false;
    }
    for (int i = 0; i < FMFTS_MOVED; i++) {
        judged->moment[i] = solved->covariance[FMFTS_STEP * i + LOG_COLUMN];
    }
    judged->moment[FMFTS_MOVED] = solved->covariance[(FMFTS_STEP + 1) * LOG_COLUMN];
    judged->over_range = touching && last->over_range;
    judged->known = tell(pad, next, time_us, outcome);
    return judged->known;
}

void fmfts_read_early(const fmfts_pose_parameters *parameters, unsigned gain_code, const int16_t counts[3], double field_t[3])
{
    int saturated = (int)parameters->saturated_count[0], largest = (int)parameters->largest_count[0];
    for (int axis = 0; axis < 3; axis++) {
        int count = counts[axis];
        bool measured = gain_code < FMFTS_GAIN_CODES && count != saturated && count <= largest && count >= -largest - 1;
        field_t[axis] = measured ? count * parameters->step_t[3 * gain_code + axis] : NAN;
    }
}

fmfts_news fmfts_early_step(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_early *early, fmfts_outcome *outcome)
{
    const fmfts_parameters *parameters = pad->parameters;
    const fmfts_now_parameters *own = &parameters->now;
    fmfts_judged *judged = &outcome->judged;
    double newest_us = 0.0, sum = early->field_t[0] + early->field_t[1] + early->field_t[2];
    for (int i = 0; i < (int)parameters->pose.sensors[0]; i++) {
        newest_us = fmax(newest_us, memory->pose.time_us[i]);
    }
    if (!(own->early_lead_us[0] > 0.0) || !judged->known || !isfinite(sum) || early->sensor < 0 || early->sensor >= (int)parameters->pose.sensors[0] ||
        !fmfts_is_next(&parameters->motion, &memory->motion, early->sensor, early->time_us) ||
        early->time_us <= memory->pose.time_us[early->sensor] ||
        early->time_us - newest_us > own->longest_lead_s[0] * 1e6) {
        return FMFTS_UNUSED;
    }
    if (!fmfts_follow_early(&parameters->pose, &parameters->motion, &memory->pose, early->sensor, early->field_t,
                            early->time_us, judged->drive, &memory->motion)) {
        memory->motion.motion_us[0] = 0.0; /* the filter stops: the next frame is Python's */
        judged->known = 0;
        return FMFTS_FOLLOWED;
    }
    double time_us = fmax(early->time_us + own->early_lead_us[0], memory->now.told_us[0]);
    return !judged->over_range && tell(pad, memory, time_us, outcome) ? FMFTS_TOLD : FMFTS_FOLLOWED;
}
