/* From a trusted pose to touch, place and force: the gaps, the lift and the deviations around contact/step.h. */
#include <math.h>

#include "../pose/model.h"
#include "steps.h"

#define MM_PER_M 1e3
/* A finger never lifts the magnet. If it stays lifted for this long, its baseline was recorded under load. */
#define LIFTED_S 0.6
/* A pull also lifts it. If the magnet is back at rest for this long, the baseline was good: a returning load passes
 * that position (to within 20 mN) in less time. */
#define RESTED_S 0.15
static const char JUMPED[] = "the field jumped between two samples by more than a finger can change it: a wire that was moved, a "
                             "blow, a magnet, or frames that this computer left out";
/* A board warms by 20 K in ten minutes. So within this time the last temperature is off by a fifth of a kelvin at most. */
#define HELD_S 5.0

bool fmfts_has_trusted_pose(fmfts_frame_work *work)
{
    const fmfts_verdict *verdict = &work->step.verdict;
    if (work->step.parameters->at_rest == 0.0) {
        return false;
    }
    if (!verdict->has_estimate || verdict->health == FMFTS_DISTURBED) {
        fmfts_unseen(&work->memory->contact);
        work->memory->pose.rested_s = 0.0;
        work->memory->pose.unseen_s += work->step.field.elapsed_s;
        work->memory->contact.recent_moved_s += work->step.field.elapsed_s;
        return false;
    }
    return true;
}

void fmfts_follow_gaps(fmfts_frame_work *work)
{
    const fmfts_pose_parameters *parameters = work->step.parameters;
    fmfts_pose_memory *memory = &work->memory->pose;
    /* Until the first temperature is read, every deviation includes the error that its absence causes. */
    bool matters = parameters->unread_warming_k > 0.0 && !isnan(parameters->rest_temperature_c) && memory->unread_variance == 0.0;
    memory->unread_s = isnan(work->step.temperature_c) && matters ? memory->unread_s + work->step.field.elapsed_s : 0.0;
    if (memory->unread_s > HELD_S) {
        fmfts_text why;
        fmfts_clear(&why);
        fmfts_say(&why, "no temperature that the chips can have for %.0f s: the last good one is held (thermometer, wiring)",
                  memory->unread_s);
        fmfts_degrade(&work->step.verdict, why.text);
    }
}

/* Whether the pose's covariance and the baseline's uncertainty include the same errors: the latter is for a solution
 * from all sensors and without neighbours. For other solutions both are kept. */
static bool counts_twice(const fmfts_step *step)
{
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        if (!step->verdict.used[axis]) {
            return false;
        }
    }
    return step->felt.count == 0;
}

void fmfts_find_change(const fmfts_pad *pad, fmfts_frame_work *work)
{
    const fmfts_contact_parameters *contact = &pad->parameters->contact;
    fmfts_step *step = &work->step;
    double elapsed_s = step->field.elapsed_s;
    work->overlaps = counts_twice(step);
    if (elapsed_s > contact->longest_gap_s) {
        fmfts_forget_touch(&work->memory->contact); /* the finger may be gone */
    }
    fmfts_follow_creep(step->parameters, step->memory, elapsed_s);
    if (work->overlaps) {
        fmfts_overlap(step, step->parameters->part[LOG_COLUMN] == FMFTS_CONSIDERED, work->overlap);
    }
    fmfts_displace(step->parameters, step->memory, step->memory->state, &step->pose,
                   work->overlaps ? (const double(*)[5])work->overlap : NULL, &work->displacement);
    work->touch_is_known =
        fmfts_touch(contact, &work->memory->contact, FMFTS_MOVED, work->displacement.change, work->displacement.at_rest);
}

bool fmfts_find_contact(const fmfts_pad *pad, fmfts_frame_work *work)
{
    const fmfts_contact_parameters *contact = &pad->parameters->contact;
    fmfts_step *step = &work->step;
    fmfts_question question;
    if (pad->parameters->message.has_model == 0.0) {
        return true;
    }
    fmfts_draw(step->parameters, step->memory->state, &work->displacement, MM_PER_M, question.pose, question.covariance);
    fmfts_smooth(contact, &work->memory->contact, step->field.elapsed_s, &question);
    fmfts_keep_inside(contact, &question);
    work->lifted_m = question.lifted_m;
    work->has_estimate = true;
    return fmfts_estimate_contact(contact, &question, &pad->network, pad->response, pad->response_bytes,
                                  &work->estimate);
}

/* Counts for how long the magnet is above its rest, and then, for how long it has been back at rest. A press may pass
 * that position, but does not hold it there. */
static void follow_lift(fmfts_pose_memory *memory, bool lifted, bool resting, double elapsed_s)
{
    memory->rested_s = memory->lifted_s > 0.0 && resting && !lifted ? memory->rested_s + elapsed_s : 0.0;
    if (lifted) {
        memory->lifted_s += elapsed_s;
    } else if (memory->lifted_s < LIFTED_S || memory->rested_s >= RESTED_S) {
        memory->lifted_s = memory->rested_s = 0.0;
    }
}

/* Whether offsets that drifted with the warmth may have moved the pose by the frame's change. The estimate weighs all errors best, so
 * larger ones on each axis widen its covariance by at most their share. */
static bool drift_explains(const fmfts_pad *pad, const fmfts_frame_work *work)
{
    double share = fmfts_hidden_drift_share(&work->step), covariance[FMFTS_MOVED * FMFTS_MOVED], chi2;
    if (!(share > 0.0)) {
        return false;
    }
    for (int i = 0; i < FMFTS_MOVED; i++) {
        for (int k = 0; k < FMFTS_MOVED; k++) {
            double of_pose = work->step.pose.covariance[FMFTS_STEP * i + k];
            covariance[FMFTS_MOVED * i + k] = work->displacement.at_rest[FMFTS_MOVED * i + k] + share * of_pose;
        }
    }
    return fmfts_chi2_from_rest(FMFTS_MOVED, work->displacement.change, covariance, &chi2) && chi2 < pad->parameters->contact.onset_chi2;
}

bool fmfts_doubt_contact(const fmfts_pad *pad, fmfts_frame_work *work)
{
    fmfts_memory *memory = work->memory;
    fmfts_verdict *verdict = &work->step.verdict;
    if (!work->has_estimate) {
        return true; /* without a contact model it is not known whether a press can lift this pad's magnet */
    }
    bool lifted = work->lifted_m > 0.0, resting = work->touch_is_known && memory->contact.touched == 0.0;
    follow_lift(&memory->pose, lifted, resting, work->step.field.elapsed_s);
    if (memory->pose.lifted_s >= LIFTED_S) {
        verdict->health = FMFTS_NO_BASELINE;
        fmfts_clear(&verdict->reason);
        fmfts_say(&verdict->reason, "%s", pad->words.lifted);
        work->has_estimate = false;
    } else if (lifted) {
        fmfts_forget_touch(&memory->contact);
        verdict->health = FMFTS_DISTURBED;
        fmfts_clear(&verdict->reason);
        fmfts_say(&verdict->reason,
                  "the magnet is %.2f mm above its rest: something pulls at the pad, or its baseline was recorded under load",
                  work->lifted_m * MM_PER_M);
        work->has_estimate = false;
    } else if (work->touch_is_known) {
        bool was_contact = memory->contact.in_contact != 0.0;
        fmfts_press(&pad->parameters->contact, &memory->contact, &work->estimate);
        if (memory->contact.in_contact != 0.0) {
            memory->contact.recent_moved_s = was_contact ? memory->contact.recent_moved_s : 0.0;
        } else if (!fmfts_compare_recent(pad, work, was_contact)) {
            return false;
        }
        bool is_recent = memory->contact.in_contact == FMFTS_RECENT_PRESS; /* since a moment before nothing has drifted */
        bool may_be_drift = memory->contact.in_contact != 0.0 && !is_recent && drift_explains(pad, work);
        fmfts_doubt_drift(&memory->contact, was_contact, may_be_drift);
        if (memory->contact.touched != 0.0 && work->estimate.over_range && fmfts_has_jumped(&work->step)) {
            fmfts_degrade(verdict, JUMPED);
        }
    }
    return true;
}

/* The deviation of the force without a detected touch: it may be anything up to the detection limit, as a uniform
 * distribution. detection_limit_n: at the pad's least sensitive place. */
static double quiet_force_sd_n(double force_sd_n, double detection_limit_n)
{
    double uniform_sd_n = detection_limit_n / sqrt(3.0);
    return sqrt(force_sd_n * force_sd_n + uniform_sd_n * uniform_sd_n);
}

/* Deviation of the estimate in contact, of 0 without contact. The less a force exceeds its noise, the more the
 * detection limit counts. If the magnet has moved but the force is not certain, or not published yet, 0 may be wrong by the
 * whole estimate. */
double fmfts_force_sd_n(const fmfts_message_parameters *parameters, const fmfts_estimate *estimate,
                        const fmfts_contact_memory *touch)
{
    double limit_n = parameters->detection_limit_n, force_n = estimate->place[2];
    if (touch->touched == 0.0 && touch->in_contact == 0.0) {
        return quiet_force_sd_n(estimate->central_force_sd_n, limit_n);
    }
    double deviation_n = quiet_force_sd_n(estimate->deviation[2], estimate->doubt * limit_n);
    bool is_sure = touch->in_contact == FMFTS_SURE_FORCE && fmfts_is_published(touch);
    return is_sure ? deviation_n : sqrt(deviation_n * deviation_n + force_n * force_n);
}
