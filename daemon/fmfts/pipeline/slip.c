/* `slip` of a message: from contact/slip.c and friction.c. It is known if the contact's place is. */
#include <math.h>
#include <string.h>

#include "../pose/model.h"
#include "steps.h"

#define MM_PER_M 1e3

/* The pose's covariance by noise alone: what the moment and the baseline leave uncertain is the same in all frames. */
static void noise_of(const fmfts_step *step, double noise[5][5])
{
    const fmfts_pose *pose = &step->pose;
    double lasting[5][5];
    fmfts_overlap(step, true, lasting);
    double moment_variance = pose->covariance[(FMFTS_STEP + 1) * LOG_COLUMN];
    for (int i = 0; i < 5; i++) {
        for (int k = 0; k < 5; k++) {
            noise[i][k] = pose->covariance[FMFTS_STEP * i + k] - lasting[i][k];
            if (moment_variance > 0.0) {
                noise[i][k] -= pose->covariance[FMFTS_STEP * i + LOG_COLUMN] *
                               pose->covariance[FMFTS_STEP * k + LOG_COLUMN] / moment_variance;
            }
        }
    }
}

/* The deviation of a shear through baseline, moment and silicone, the mean of both axes: the same in all frames.
 * Stiffness is excluded, because it scales force and shear alike. whole, noise [POSE][POSE]: of the pose. */
static double lasting_shear_n(const fmfts_estimate *estimate, const double *whole, const double *noise)
{
    double variance = 0.0;
    for (int shear = 3; shear < FMFTS_CONTACT; shear++) {
        const double *row = estimate->by_pose + FMFTS_POSE * shear;
        for (int i = 0; i < FMFTS_POSE; i++) {
            for (int k = 0; k < FMFTS_POSE; k++) {
                int at = FMFTS_POSE * i + k;
                variance += row[i] * (whole[at] - noise[at]) * row[k];
            }
        }
    }
    return sqrt(fmax(0.5 * variance, 0.0));
}

bool fmfts_is_slipping(const fmfts_reading *reading)
{
    return reading->tells_slip && reading->slip.known && reading->slip.slipping;
}

void fmfts_find_slip(const fmfts_pad *pad, fmfts_frame_work *work, fmfts_reading *reading)
{
    const fmfts_parameters *parameters = pad->parameters;
    if (parameters->slip.tells_slip == 0.0) {
        return;
    }
    fmfts_slip_memory *memory = &work->memory->slip;
    const fmfts_estimate *estimate = &work->estimate;
    fmfts_slip_frame frame = {.elapsed_s = work->step.field.elapsed_s};
    fmfts_response response;
    bool touching = work->has_estimate && fmfts_is_published(&work->memory->contact);
    if (!touching || estimate->refused || estimate->over_range || frame.elapsed_s > parameters->contact.longest_gap_s ||
        !pad->response || !fmfts_view_response(pad->response, pad->response_bytes, &response) || response.loads != 3) {
        fmfts_forget_slip(memory);
        return;
    }
    double pose[FMFTS_POSE], whole[FMFTS_POSE * FMFTS_POSE], noise[FMFTS_POSE * FMFTS_POSE];
    fmfts_displacement drawn = work->displacement;
    fmfts_draw(work->step.parameters, work->step.memory->state, &drawn, MM_PER_M, pose, whole);
    noise_of(&work->step, drawn.covariance);
    fmfts_draw(work->step.parameters, work->step.memory->state, &drawn, MM_PER_M, pose, noise);
    for (int i = 0; i < FMFTS_MOVED; i++) {
        frame.change[i] = pose[i] - parameters->contact.model_rest[i];
        for (int k = 0; k < FMFTS_MOVED; k++) {
            frame.noise[FMFTS_MOVED * i + k] = noise[FMFTS_POSE * i + k];
        }
    }
    frame.shear_sd_n = lasting_shear_n(estimate, whole, noise);
    if (frame.elapsed_s > 0.0) { /* repeated samples are no news: their noise would look like a motion */
        fmfts_follow_slip(&response, &frame, estimate, memory);
    }
    fmfts_judge_slip(&parameters->slip, &frame, memory, &reading->slip);
}
