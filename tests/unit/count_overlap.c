/* For steps_in_c.py: the overlap of a frame whose numbers are given. */
#include "../../daemon/fmfts/pose/step.h"

#include <string.h>

void count_overlap(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const double *unknown_t2,
                   const double *variance_t2, const double *slopes, double overlap[5][5])
{
    fmfts_step step = {.parameters = parameters, .memory = memory};
    size_t axes = 3 * (size_t)parameters->sensors, size = axes * sizeof(double);
    memcpy(step.field.unknown_t2, unknown_t2, size);
    memcpy(step.field.variance_t2, variance_t2, size);
    memcpy(step.slopes, slopes, FMFTS_STEP * size);
    fmfts_overlap(&step, overlap);
}
