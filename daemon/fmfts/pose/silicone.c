/* What silicone adds to the uncertainty of a change of pose: silicone.py. */
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

void fmfts_follow_creep(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, double elapsed_s)
{
    double change[5];
    fmfts_change(parameters, memory->state, change);
    bool before = elapsed_s > parameters->unseen_gap_s[0] && square_of(memory->pressed) > square_of(change);
    const double *held = before ? memory->pressed : change;
    for (int decade = 0; decade < FMFTS_DECADES; decade++) {
        double gained = elapsed_s / (elapsed_s + parameters->creep_time_s[decade]);
        for (int i = 0; i < 5; i++) {
            memory->crept[5 * decade + i] += gained * (held[i] - memory->crept[5 * decade + i]);
        }
    }
    memcpy(memory->pressed, change, sizeof memory->pressed);
}

void fmfts_creep(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double change[5],
                 double covariance[5][5])
{
    double share = parameters->silicone_share[0] * parameters->silicone_share[0];
    double creep = parameters->creep_share[0] * parameters->creep_share[0];
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
