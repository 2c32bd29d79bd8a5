/* What the posture of a hand does to the field of a pad on it: its own steel, motors and other magnets. hand.py computes
 * it for the newest joint positions, and how fast it changes; here it is subtracted at a frame's time. */
#include "step.h"

void fmfts_take_posture(fmfts_step *step, const fmfts_hand *hand, double time_ns)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_field *field = &step->field;
    step->posture = FMFTS_POSTURE_NONE;
    if (!hand->state) {
        return;
    }
    double later_s = (time_ns - *hand->time_ns) * 1e-9, goes_on_s = fmfts_goes_on_s(later_s), unsure_s = fmfts_unsure_s(later_s);
    step->posture = fmfts_posture_at(*hand->state, later_s);
    step->joints_later_s = later_s;
    bool is_known = step->posture == FMFTS_POSTURE_KNOWN;
    for (int axis = 0; axis < 3 * (int)parameters->sensors; axis++) {
        double field_t = hand->wide_field_t[axis], variance_t2 = hand->wide_variance_t2[axis], gain = parameters->gain[axis];
        if (is_known || step->posture == FMFTS_POSTURE_OUTSIDE) {
            field_t = hand->field_t[axis];
            variance_t2 = hand->variance_t2[axis];
        }
        if (is_known) {
            field_t += hand->rate_t_per_s[axis] * goes_on_s;
            variance_t2 += hand->rate_variance[axis] * (unsure_s * unsure_s);
        }
        field->field_t[axis] -= field_t / gain;
        variance_t2 /= gain * gain;
        field->other_t2[axis] += variance_t2;
        field->variance_t2[axis] += variance_t2;
    }
}

void fmfts_doubt_posture(fmfts_step *step)
{
    fmfts_verdict *verdict = &step->verdict;
    /* Without joints the deviations cover all recorded postures: a frame is degraded only if the pose is lost. */
    bool is_covered = step->posture == FMFTS_POSTURE_ANY && verdict->health != FMFTS_LOST;
    if (step->posture == FMFTS_POSTURE_NONE || step->posture == FMFTS_POSTURE_KNOWN || is_covered) {
        return;
    }
    fmfts_say(&verdict->reason, "%s", verdict->reason.size ? "; " : "");
    fmfts_say_posture(step->posture, step->joints_later_s, &verdict->reason);
    if (verdict->health == FMFTS_OK) {
        verdict->health = FMFTS_DEGRADED;
    }
}
