/* A press that the change since the baseline hides.
 *
 * Gains and rotations that the baseline leaves wrong move the estimate with the ambient field, slowly, as a robot turns. So the pose is
 * also compared with the mean pose of a moment before, in the ambient field of that moment: only the change of that field
 * since then adds errors (change.c). Steel that passes would be noticed farther away, too, so a press has to explain more. */
#include <string.h>

#include "../pose/model.h"
#include "../pose/motion.h"
#include "steps.h"

#define MM_PER_M 1e3
/* The time constant of the mean. A press reaches its force in less, and stops the mean as soon as it shows. */
#define MEAN_S 0.25
/* A change that no press explains is taken for rest after this time: steel was put down, or a finger was there before. */
#define UNEXPLAINED_S 5.0
/* After this time, if it raises the magnet, which no press does: a finger left that the turned field's errors had hidden. */
#define RAISED_S 0.1
/* A change that a press explains is taken for rest after this time: the turned field's errors have hidden the press by then. */
#define LONGEST_S 30.0
/* A press explains this share of its change, as a contact begins and later. A slow tool of 0.02 A·m² at 45 mm: to 0.96. */
#define BEGINNING_SHARE 0.98
#define KEPT_SHARE 0.9
/* A change of the axis by a larger square is that of no press. */
#define MOST_TILT2 0.25

static void follow_rest(const fmfts_frame_work *work, fmfts_contact_memory *memory)
{
    const double *ambient_t = work->step.memory->state + AMBIENT_VALUE, elapsed_s = work->step.field.elapsed_s;
    double gained = elapsed_s / (elapsed_s + MEAN_S);
    for (int i = 0; i < FMFTS_MOVED; i++) {
        memory->recent_change[i] += gained * (work->displacement.change[i] - memory->recent_change[i]);
    }
    for (int i = 0; i < 3; i++) {
        memory->recent_ambient_t[i] += gained * (ambient_t[i] - memory->recent_ambient_t[i]);
    }
}

/* Whether the frame's own errors explain a change [5]. All errors, which take longer to compute, then do so, too. */
static bool is_noise(const fmfts_frame_work *work, const double *change, double most_chi2)
{
    double own[FMFTS_MOVED * FMFTS_MOVED], chi2;
    for (int i = 0; i < FMFTS_MOVED; i++) {
        for (int k = 0; k < FMFTS_MOVED; k++) {
            double twice = work->overlaps ? work->overlap[i][k] : 0.0;
            own[FMFTS_MOVED * i + k] = work->step.pose.covariance[FMFTS_STEP * i + k] - twice;
        }
    }
    return fmfts_chi2_from_rest(FMFTS_MOVED, change, own, &chi2) && chi2 < most_chi2;
}

/* The displacement by a change [5] since the recent rest, as if the baseline had been recorded there. */
static void displace(const fmfts_frame_work *work, const double *change, double state[FMFTS_STATE], fmfts_displacement *since)
{
    const fmfts_step *step = &work->step;
    double turn[2][3];
    memcpy(state, step->memory->state, FMFTS_STATE * sizeof(double));
    fmfts_pose_after(step->parameters, change, state, state + AXIS_VALUE, turn);
    for (int i = 0; i < 3; i++) {
        state[AMBIENT_VALUE + i] -= work->memory->contact.recent_ambient_t[i];
    }
    fmfts_displace(step->parameters, step->memory, state, &step->pose, work->overlaps ? work->overlap : NULL, since);
}

bool fmfts_compare_recent(const fmfts_pad *pad, fmfts_frame_work *work, bool was_contact)
{
    const fmfts_contact_parameters *contact = &pad->parameters->contact;
    fmfts_contact_memory *memory = &work->memory->contact;
    double change[FMFTS_MOVED], state[FMFTS_STATE], chi2, needed = was_contact ? contact->release_chi2 : contact->onset_chi2;
    fmfts_displacement since;
    fmfts_question question;
    fmfts_estimate estimate;
    if (pad->network.outputs == FMFTS_CONTACT || contact->hidden_force_sd_n > 0.0) {
        return true; /* presses with shear explain most changes, and a hidden force shifts the place: as in contact/touch.c */
    }
    for (int i = 0; i < FMFTS_MOVED; i++) {
        change[i] = work->displacement.change[i] - memory->recent_change[i];
    }
    bool is_quiet = is_noise(work, change, contact->release_chi2) || change[3] * change[3] + change[4] * change[4] > MOST_TILT2;
    if (!is_quiet) {
        displace(work, change, state, &since);
        is_quiet = !fmfts_chi2_from_rest(FMFTS_MOVED, since.change, since.at_rest, &chi2) || chi2 < contact->release_chi2;
    }
    if (is_quiet) {
        memory->recent_moved_s = 0.0;
        follow_rest(work, memory);
        return true;
    }
    memory->recent_moved_s += work->step.field.elapsed_s;
    if (memory->recent_moved_s > (was_contact ? LONGEST_S : change[2] > 0.0 ? RAISED_S : UNEXPLAINED_S)) {
        follow_rest(work, memory);
        return true;
    }
    if (!(chi2 > needed) || !(work->estimate.place[2] > 0.0)) {
        return true;
    }
    fmfts_draw(work->step.parameters, state, &since, MM_PER_M, question.pose, question.covariance);
    fmfts_keep_inside(contact, &question);
    if (!fmfts_estimate_contact(contact, &question, &pad->network, pad->response, pad->response_bytes, &estimate)) {
        return false;
    }
    bool is_press = estimate.lowered_chi2 > needed && estimate.explained > (was_contact ? KEPT_SHARE : BEGINNING_SHARE);
    if (is_press && question.lifted_m == 0.0 && !estimate.over_range) {
        memory->in_contact = FMFTS_RECENT_PRESS;
    }
    return true;
}
