/* For pose_steps_in_c.py: steps that need a complete frame, which is made here from plain numbers. */
#include "../../daemon/fmfts/pose/model.h"
#include "../../daemon/fmfts/pose/step.h"

#include <string.h>

static size_t bytes_of(const fmfts_pose_parameters *parameters)
{
    return 3 * (size_t)parameters->sensors * sizeof(double);
}

void count_overlap(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const double *unknown_t2,
                   const double *variance_t2, const double *slopes, double overlap[5][5])
{
    fmfts_step step = {.parameters = parameters, .memory = memory};
    size_t size = bytes_of(parameters);
    memcpy(step.field.unknown_t2, unknown_t2, size);
    memcpy(step.field.variance_t2, variance_t2, size);
    memcpy(step.slopes, slopes, FMFTS_STEP * size);
    fmfts_overlap(&step, parameters->part[LOG_COLUMN] == FMFTS_CONSIDERED, overlap);
}

/* tables: the doubles of each pad's Sighting (sighting.py). added_t, added_t2: to the field and its variance. rest, now: of all
 * magnets. covariance: of a step of all. */
void feel(const fmfts_pose_parameters *parameters, double *const *tables, double time_ns, double *added_t, double *added_t2,
          double *rest, double *now, double *covariance)
{
    fmfts_step step = {.parameters = parameters};
    fmfts_sighting seen[FMFTS_FELT];
    for (size_t pad = 0; pad < (size_t)parameters->neighbours; pad++) {
        seen[pad] = fmfts_view_sighting(tables[pad], (size_t)parameters->neighbour_magnets[pad]);
    }
    fmfts_feel(&step, seen, time_ns);
    memcpy(added_t, step.field.field_t, bytes_of(parameters));
    memcpy(added_t2, step.field.variance_t2, bytes_of(parameters));
    memcpy(rest, step.felt.rest, step.felt.count * sizeof step.felt.rest[0]);
    memcpy(now, step.felt.now, step.felt.count * sizeof step.felt.now[0]);
    memcpy(covariance, step.felt.covariance, FMFTS_MOVES * FMFTS_MOVES * step.felt.count * step.felt.count * sizeof(double));
}
