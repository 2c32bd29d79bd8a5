/* Decides whether the pad is in contact: a χ² test of the magnet's displacement from rest, a press that explains the displacement,
 * and a force that is certain, or else a press that is.
 *
 * All have hysteresis. Steel near a pad moves the estimate sideways by many deviations, without a force: no controller
 * should act on that.
 */
#include <math.h>

#include <string.h>

#include "../arithmetic/matrix.h"
#include "step.h"

/* A contact begins when its force exceeds FMFTS_CERTAIN_FORCE_DEVIATIONS of its deviations, and ends below so many. */
#define KEPT_FORCE_DEVIATIONS 1.0

/* Of presses of another solver, by fingers of 3 to 12 mm, in other silicone and with a friction of 0.3, 99 in 100 are explained to 0.95
 * or more; steel is mostly to 0.1 to 0.6. Beyond the calibrated forces the table continues along its tangents, so the
 * share falls, but a squeeze must stay a contact. At the end of a light touch, most of the movement is creep of the
 * silicone. */
#define BEYOND_SHARE 0.5
#define KEPT_SHARE 0.25
/* Noise of one frame can begin a touch, and that lasts for at most FMFTS_RELEASE_FRAMES. One frame more needs a second cause. */
#define LASTING_FRAMES (FMFTS_RELEASE_FRAMES + 1)
/* Where the force is not certain: so much of nearly every press, and of few frames beside a magnet. */
#define PRESS_SHARE 0.95

bool fmfts_chi2_from_rest(size_t numbers, const double *change, const double *covariance, double *chi2)
{
    double root[FMFTS_MOST_CHANGE * FMFTS_MOST_CHANGE], white[FMFTS_MOST_CHANGE];
    memcpy(root, covariance, numbers * numbers * sizeof(double));
    memcpy(white, change, numbers * sizeof(double));
    if (!fmfts_cholesky(numbers, root)) {
        return false;
    }
    fmfts_solve_lower(numbers, 1, root, white);
    fmfts_product(1, numbers, 1, white, white, chi2);
    return isfinite(*chi2);
}

static void follow(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, double chi2)
{
    memory->quiet_frames = chi2 < parameters->release_chi2 ? memory->quiet_frames + 1.0 : 0.0;
    if (chi2 > parameters->onset_chi2) {
        memory->touched = 1.0;
    } else if (memory->quiet_frames >= FMFTS_RELEASE_FRAMES) {
        memory->touched = 0.0;
    }
}

bool fmfts_touch(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, size_t numbers,
                 const double *change, const double *covariance)
{
    double chi2;
    if (!fmfts_chi2_from_rest(numbers, change, covariance, &chi2)) {
        return false;
    }
    follow(parameters, memory, chi2);
    return true;
}

/* Where the pose is uncertain, a firm press on the rim and a light one nearer the middle look alike: the force has a wide
 * deviation, and yet no force explains the pose far worse. So a press that lowers χ² by enough is certain, too, but not where
 * steel passes. A refused estimate counts as certain. hidden_force_sd_n: of a force with a hidden cause, which the pose's covariance
 * does not include. Such a cause also shifts the place, so the model's error there is doubtful. */
void fmfts_press(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, const fmfts_estimate *estimate)
{
    bool was_contact = memory->in_contact == FMFTS_SURE_FORCE || memory->in_contact == FMFTS_SURE_PRESS;
    double needed = memory->in_contact == FMFTS_SURE_FORCE ? KEPT_FORCE_DEVIATIONS : FMFTS_CERTAIN_FORCE_DEVIATIONS;
    double hidden_n = parameters->hidden_force_sd_n;
    double deviation_n = estimate->pose_force_sd_n;
    if (hidden_n > 0.0) {
        deviation_n = estimate->own_force_sd_n > hidden_n ? estimate->own_force_sd_n : hidden_n;
    }
    bool is_certain = estimate->refused || estimate->place[2] > needed * deviation_n;
    double lowered = was_contact ? parameters->release_chi2 : parameters->onset_chi2;
    double of_press = memory->in_contact == FMFTS_SURE_PRESS ? FMFTS_EXPLAINED_SHARE : PRESS_SHARE;
    bool is_press = hidden_n == 0.0 && estimate->lowered_chi2 > lowered && estimate->explained > of_press;
    double beginning = estimate->is_beyond ? BEYOND_SHARE : FMFTS_EXPLAINED_SHARE;
    double share = was_contact ? KEPT_SHARE : beginning;
    bool contact = memory->touched != 0.0 && (is_certain || is_press) && estimate->explained > share;
    memory->in_contact = !contact ? 0.0 : is_certain ? FMFTS_SURE_FORCE : FMFTS_SURE_PRESS;
}

/* Offsets that drift far can move the estimate as a light press does, and leave no residual. Noise on top of that drift exceeds the
 * thresholds for single frames, while a press stays. A mean of the pose would follow both: it would hide slow presses. */
void fmfts_doubt_drift(fmfts_contact_memory *memory, bool was_contact, bool drift_explains)
{
    double frames = was_contact && memory->doubtful_frames == 0.0 ? LASTING_FRAMES : memory->doubtful_frames + 1.0;
    bool is_doubtful = memory->in_contact != 0.0 && drift_explains && frames < LASTING_FRAMES;
    memory->doubtful_frames = is_doubtful ? frames : 0.0;
}

bool fmfts_is_published(const fmfts_contact_memory *memory)
{
    return memory->in_contact != 0.0 && memory->doubtful_frames == 0.0;
}

/* Without this a false contact would follow one gap in a hundred, because one unloaded frame in a hundred is not close to
 * rest. */
void fmfts_unseen(fmfts_contact_memory *memory)
{
    memory->quiet_frames = fmin(memory->quiet_frames + 1.0, FMFTS_RELEASE_FRAMES);
    if (memory->quiet_frames == FMFTS_RELEASE_FRAMES) {
        memory->touched = memory->in_contact = memory->doubtful_frames = 0.0;
    }
}

void fmfts_forget_touch(fmfts_contact_memory *memory)
{
    memory->touched = memory->quiet_frames = memory->in_contact = memory->doubtful_frames = 0.0;
}
