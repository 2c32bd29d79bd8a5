/* What the posture of a hand does to the field of a pad on it: its own steel, motors and other magnets. hand.py tells the field
 * for the newest joint positions, and how fast it changes; here it is taken off at a frame's time. */
#include <math.h>

#include "step.h"

/* As in hand.py. */
static const double GOES_ON_S = 0.1, SILENT_S = 0.25, AHEAD_S = 0.5, STAMP_S = 3e-3, UNFORESEEN = 0.5;

static fmfts_posture posture_of(const fmfts_hand *hand, double later_s)
{
    if (*hand->state == 2.0) {
        return FMFTS_POSTURE_UNTAUGHT;
    }
    if (*hand->state == 5.0) {
        return FMFTS_POSTURE_ANY;
    }
    if (*hand->state == 3.0 || isnan(later_s)) {
        return FMFTS_POSTURE_NO_JOINTS;
    }
    if (later_s > SILENT_S) {
        return FMFTS_POSTURE_SILENT;
    }
    if (later_s < -AHEAD_S) {
        return FMFTS_POSTURE_AHEAD;
    }
    if (*hand->state == 6.0) {
        return FMFTS_POSTURE_NO_REST;
    }
    return *hand->state == 1.0 ? FMFTS_POSTURE_KNOWN : FMFTS_POSTURE_OUTSIDE;
}

void fmfts_take_posture(fmfts_step *step, const fmfts_hand *hand, double time_ns)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_field *field = &step->field;
    step->posture = FMFTS_POSTURE_NONE;
    if (!hand->state) {
        return;
    }
    double later_s = (time_ns - *hand->time_ns) * 1e-9, goes_on_s = fmin(later_s, GOES_ON_S);
    double unsure_s = STAMP_S + UNFORESEEN * fmax(later_s, 0.0);
    step->posture = posture_of(hand, later_s);
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
    const char *before = verdict->reason.size ? "; " : "";
    bool is_told = step->posture == FMFTS_POSTURE_ANY && verdict->health != FMFTS_LOST;
    if (step->posture == FMFTS_POSTURE_NONE || step->posture == FMFTS_POSTURE_KNOWN || is_told) {
        return;
    }
    switch (step->posture) {
    case FMFTS_POSTURE_UNTAUGHT:
        fmfts_say(&verdict->reason, "%sthe field of the hand's posture was not taught: `fmfts-daemon baseline --posture`", before);
        break;
    case FMFTS_POSTURE_NO_JOINTS:
        fmfts_say(&verdict->reason, "%sno joint positions have arrived: docs/scene.md says how to publish them", before);
        break;
    case FMFTS_POSTURE_SILENT:
        fmfts_say(&verdict->reason, "%sjoint positions stopped arriving %.1f s ago: start the program that publishes them", before,
                  step->joints_later_s);
        break;
    case FMFTS_POSTURE_AHEAD:
        fmfts_say(&verdict->reason,
                  "%sjoint positions are stamped %.1f s ahead of the frames: stamp them by this computer's monotonic clock", before,
                  -step->joints_later_s);
        break;
    case FMFTS_POSTURE_ANY:
        fmfts_say(&verdict->reason, "%sthe postures change the field by too much to do without joint positions", before);
        break;
    case FMFTS_POSTURE_NO_REST:
        fmfts_say(&verdict->reason,
                  "%sthe joints of the rest recording are not known: `fmfts-daemon baseline --rest` while joint positions are "
                  "published", before);
        break;
    default:
        fmfts_say(&verdict->reason, "%sthe hand is in a posture that was not taught: `fmfts-daemon baseline --posture`", before);
    }
    if (verdict->health == FMFTS_OK) {
        verdict->health = FMFTS_DEGRADED;
    }
}
