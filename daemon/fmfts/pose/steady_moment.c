/* Remembers the magnet's moment if each frame estimates its own. Warming and ageing change it over minutes, so a moment
 * that jumps is really an ambient field. In one frame a uniform field along the pad's normal equals a stronger magnet,
 * farther away. All frames of a press have the same error of the moment: averaging reduces only the noise in its
 * variance. */
#include "model.h"
#include "tracking.h"

/* The mean forgets over so many frames (a second at 220 Hz), and is known after so many. */
enum { MEMORY_FRAMES = 220, KNOWN_FRAMES = 32 };
/* After a longer gap the magnet may have warmed. If its moment has differed for this many frames without a break, it is
 * another magnet. */
#define GAP_S 2.0
enum { LEAPT_FRAMES = 64 };

bool fmfts_knows_moment(const fmfts_step *step)
{
    return step->parameters->at_rest != 0.0 && step->parameters->part[LOG_COLUMN] == FMFTS_FREE &&
           step->memory->steady_frames >= KNOWN_FRAMES;
}

/* The share of the axes' variance that is not noise. */
static double lasting_share(const fmfts_step *step)
{
    double lasting = 0.0, all = 0.0;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        lasting += step->field.unknown_t2[axis] + step->field.other_t2[axis];
        all += step->field.variance_t2[axis];
    }
    return lasting / all;
}

static void remember(fmfts_step *step, double moment, double variance)
{
    fmfts_pose_memory *memory = step->memory;
    if (step->field.elapsed_s > GAP_S || memory->disturbed_frames >= LEAPT_FRAMES) {
        memory->steady_frames = 0.0;
    }
    memory->steady_frames = fmin(memory->steady_frames + 1.0, MEMORY_FRAMES);
    double share = fmin(lasting_share(step) + 1.0 / memory->steady_frames, 1.0), gain = 1.0 / memory->steady_frames;
    memory->steady_moment += gain * (moment - memory->steady_moment);
    memory->steady_variance += gain * (share * variance - memory->steady_variance);
}

void fmfts_compare_moment(fmfts_step *step, const fmfts_solved *solved)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    const fmfts_pose_memory *memory = step->memory;
    double moment = solved->state[LOG_VALUE], variance = solved->covariance[(FMFTS_STEP + 1) * LOG_COLUMN];
    step->misfit = (fmfts_misfit){.known = solved->status == FMFTS_CONVERGED && solved->freedom > 0,
                                  .freedom = solved->freedom, .chi2 = solved->chi2};
    if (parameters->part[LOG_COLUMN] != FMFTS_FREE || memory->alternates ||
        !fmfts_fits(parameters, solved, fmfts_strongest(parameters))) {
        return;
    }
    if (fmfts_knows_moment(step)) {
        step->misfit.moment = (moment - memory->steady_moment) / sqrt(variance + memory->steady_variance);
        step->misfit.chi2 += step->misfit.moment * step->misfit.moment;
        step->misfit.freedom++;
    }
    remember(step, moment, variance);
}
