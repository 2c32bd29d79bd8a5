/* What silicone adds to the uncertainty of a change of pose: it creeps under a load, and recovers slowly afterwards.
 *
 * A spring would always move the magnet equally far under the same force. Silicone moves further the longer the load
 * lasts, and recovers as slowly. The amount differs from pad to pad, so nothing is corrected; the deviations include
 * it. The change of pose, filtered with a time constant for each decade, gives how far each decade can have crept, and
 * in which direction. */
#include <string.h>

#include "step.h"

static double square_of(const double change[5])
{
    double sum = 0.0;
    for (int i = 0; i < 5; i++) {
        sum += change[i] * change[i];
    }
    return sum;
}

/* After a gap, the load before or after it counts for all of it, whichever is larger. */
void fmfts_follow_creep(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, double elapsed_s)
{
    double change[5], unseen_s = memory->unseen_s + elapsed_s;
    fmfts_change(parameters, memory->state, change);
    bool before = unseen_s > parameters->unseen_gap_s && square_of(memory->pressed) > square_of(change);
    const double *held = before ? memory->pressed : change;
    memory->unseen_s = 0.0;
    for (int decade = 0; decade < FMFTS_DECADES; decade++) {
        double gained = unseen_s / (unseen_s + parameters->creep_time_s[decade]);
        for (int i = 0; i < 5; i++) {
            memory->crept[5 * decade + i] += gained * (held[i] - memory->crept[5 * decade + i]);
        }
    }
    memcpy(memory->pressed, change, sizeof memory->pressed);
}

/* The share of the change itself covers hysteresis, and creep that is faster than a calibration measures. The rest
 * covers what earlier loads have left. Decades count as independent, but all creep the same way. */
void fmfts_creep(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double change[5],
                 double covariance[5][5])
{
    double share = parameters->silicone_share * parameters->silicone_share;
    double creep = parameters->creep_share * parameters->creep_share;
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < 5; j++) {
            double sum = 0.0;
            for (int decade = 0; decade < FMFTS_DECADES; decade++) {
                sum += memory->crept[5 * decade + i] * memory->crept[5 * decade + j];
            }
            covariance[i][j] += share * change[i] * change[j] + creep * sum;
        }
    }
}
