/* `now` of a healthy frame's message: NowEstimator.update. */
#include <math.h>
#include <string.h>

#include "../../pose/model.h"
#include "frame_step.h"

enum { CONTACT = FMFTS_CONTACT, POSE = FMFTS_POSE, STATES = FMFTS_MOTION_STATES, MOVING = 1 };

#define MM_PER_M 1e3
static const double UNIT[CONTACT] = {1e-3, 1e-3, 1.0}; /* mm → m; newtons stay */

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
static void at_newest(const fmfts_pose_parameters *parameters, const fmfts_motion_memory *memory, const fmfts_pose *solved,
                      double *state, fmfts_pose *pose)
{
    double turn[2][3], moment_variance = solved->covariance[(FMFTS_STEP + 1) * LOG_COLUMN];
    fmfts_pose_after(parameters, memory->motion_state, state, state + AXIS_VALUE, turn);
    memcpy(state + AMBIENT_VALUE, memory->motion_state + FMFTS_AMBIENT_CHANGE, 3 * sizeof(double));
    for (int i = 0; i < 5; i++) {
        for (int k = 0; k < 5; k++) {
            double *own = &pose->covariance[FMFTS_STEP * i + k];
            *own = memory->motion_covariance[STATES * i + k];
            if (moment_variance > 0.0) {
                *own += solved->covariance[FMFTS_STEP * i + LOG_COLUMN] * solved->covariance[FMFTS_STEP * k + LOG_COLUMN] /
                        moment_variance;
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
    for (int c = 0; c < CONTACT; c++) {
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
    const double *from[4] = {now->value, now->deviation, now->rate, now->rate_deviation};
    for (int i = 0; i < 4; i++) {
        *x[i] = from[i][0];
        *y[i] = from[i][1];
        *force[i] = from[i][2];
    }
}

bool fmfts_tell_now(const fmfts_parameters *parameters, fmfts_memory *next, const fmfts_frame *frame,
                    const fmfts_pose *solved, const fmfts_estimate *last, const fmfts_network *network,
                    const void *response, size_t response_bytes, fmfts_outcome *outcome)
{
    const fmfts_now_parameters *own = &parameters->now;
    bool touching = next->contact.touched[0] != 0.0;
    double drive[FMFTS_MOVED * FMFTS_MOVED], state[FMFTS_STATE];
    fmfts_pose pose = {.chi2 = 0.0};
    fmfts_displacement displacement;
    fmfts_question question;
    fmfts_estimate estimate;
    fmfts_contact_now now;
    double chi2, time_us = publish_us(own, frame, &next->now);
    if (!fmfts_drive(own, response, response_bytes, touching ? last : NULL, drive) ||
        !fmfts_follow(&parameters->pose, &parameters->motion, &next->pose, frame->fresh, drive, &next->motion)) {
        return false;
    }
    double lead_s = (time_us - next->motion.motion_us[0]) * 1e-6;
    if (next->motion.followed[0] < own->settled_frames[0] || !(lead_s >= 0.0 && lead_s <= own->longest_lead_s[0])) {
        return false;
    }
    memcpy(state, next->pose.state, sizeof state);
    at_newest(&parameters->pose, &next->motion, solved, state, &pose);
    fmfts_displace(&parameters->pose, &next->pose, state, &pose, &displacement);
    fmfts_draw(&parameters->pose, state, &displacement, MM_PER_M, question.pose, question.covariance);
    if (!fmfts_chi2_from_rest(displacement.change, displacement.at_rest, &chi2) ||
        !fmfts_keep_inside(&parameters->contact, &question) ||
        !fmfts_estimate_contact(&parameters->contact, &question, network,
                                parameters->contact.refine_steps[0] > 0.0 ? response : NULL, response_bytes, &estimate)) {
        return false;
    }
    if (touching && estimate.over_range && !last->over_range) {
        return false; /* not known, which only Python says */
    }
    memcpy(now.value, estimate.place, sizeof now.value);
    memcpy(now.deviation, estimate.deviation, sizeof now.deviation);
    now.deviation[2] = fmfts_force_sd_n(&parameters->message, &estimate, touching);
    rates(&parameters->pose, &next->motion, &displacement, estimate.by_pose, &now);
    fmfts_shrink(own, next->motion.modes[MOVING], &now);
    bool pressed = next->motion.motion_state[2] < 0.0 && chi2 > parameters->contact.release_chi2[0] && estimate.doubt < 1.0;
    fmfts_carry(own, lead_s, pressed, &now);
    outcome->now_us = time_us;
    put_now(&now, &outcome->numbers);
    return true;
}
