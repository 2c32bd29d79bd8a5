/* The magnets of neighbouring pads, which are unknowns beside the pad's own. Their prior is their own pad's last
 * estimate.
 *
 * The baseline already subtracts the field of the neighbours at rest. Their modelled field at rest is therefore added again,
 * and the solve models the magnets where they are now: only the change between the two counts.
 */
#include <math.h>
#include <string.h>

#include "model.h"
#include "step.h"

/* Takes the magnets of one pad, of which `first` is the first among all that are felt. */
static void feel_pad(const fmfts_pose_parameters *parameters, size_t pad, const fmfts_sighting *seen, size_t first,
                     fmfts_felt *felt)
{
    for (size_t m = 0; m < seen->magnets; m++) {
        size_t n = first + m;
        memcpy(felt->magnet[n], parameters->neighbour_magnet + FMFTS_MAGNET * n, sizeof felt->magnet[n]);
        memcpy(felt->rest_error[n], seen->rest_error + 2 * m, sizeof felt->rest_error[n]);
        felt->placement_m[n] = parameters->neighbour_placement_m[pad];
    }
}

static void field_of(const fmfts_pose_parameters *parameters, int sensor, const double magnet[FMFTS_MAGNET],
                     const double placed[FMFTS_PLACED], double field_t[3])
{
    fmfts_field_of_placed(magnet, placed, parameters->place_m + 3 * sensor, parameters->direction + 9 * sensor, field_t);
}

static void add_to_field(const fmfts_pose_parameters *parameters, const fmfts_felt *felt, fmfts_field *field)
{
    for (int sensor = 0; sensor < (int)parameters->sensors; sensor++) {
        double variance_t2 = 0.0;
        for (size_t n = 0; n < felt->count; n++) {
            double rest_t[3], change_t[3];
            field_of(parameters, sensor, felt->magnet[n], felt->rest[n], rest_t);
            field_of(parameters, sensor, felt->magnet[n], felt->now[n], change_t);
            for (int i = 0; i < 3; i++) {
                field->field_t[3 * sensor + i] += rest_t[i];
                change_t[i] -= rest_t[i];
            }
            variance_t2 += fmfts_placement_variance(felt->rest_error[n], felt->placement_m[n], felt->now[n],
                                                    parameters->place_m + 3 * sensor, change_t);
        }
        for (int axis = 3 * sensor; axis < 3 * sensor + 3; axis++) {
            field->other_t2[axis] += variance_t2;
            field->variance_t2[axis] += variance_t2;
        }
    }
}

void fmfts_feel(fmfts_step *step, const fmfts_sighting *seen, double time_ns)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    fmfts_felt *felt = &step->felt;
    size_t pads = (size_t)parameters->neighbours;
    felt->count = 0;
    for (size_t pad = 0; pad < pads; pad++) {
        felt->count += seen[pad].magnets;
    }
    if (felt->count == 0) {
        return;
    }
    size_t first = 0, width = FMFTS_MOVES * felt->count;
    memset(felt->covariance, 0, width * width * sizeof(double));
    for (size_t pad = 0; pad < pads; pad++) {
        fmfts_seen own = {felt->rest + first, felt->now + first, felt->covariance + (width + 1) * FMFTS_MOVES * first, width};
        feel_pad(parameters, pad, &seen[pad], first, felt);
        fmfts_see(parameters->neighbour_turn + 9 * pad, parameters->neighbour_place_m + 3 * pad, &seen[pad], time_ns, &own);
        first += seen[pad].magnets;
    }
    add_to_field(parameters, felt, &step->field);
}

void fmfts_take_neighbours(const fmfts_step *step, const double placed[][FMFTS_PLACED], double field_t[FMFTS_AXES])
{
    const fmfts_felt *felt = &step->felt;
    for (int sensor = 0; sensor < (int)step->parameters->sensors; sensor++) {
        for (size_t n = 0; n < felt->count; n++) {
            double taken_t[3];
            field_of(step->parameters, sensor, felt->magnet[n], placed[n], taken_t);
            for (int i = 0; i < 3; i++) {
                field_t[3 * sensor + i] -= taken_t[i];
            }
        }
    }
}

/* A neighbour turns with the robot, so the bare recording took its field for the Earth's. */
fmfts_reference fmfts_reference_beside(const fmfts_pose_parameters *parameters, const fmfts_felt *felt)
{
    fmfts_reference reference = {.strength_t = parameters->reference_strength_t};
    int sensors = (int)parameters->sensors;
    memcpy(reference.field_t, parameters->reference_t, sizeof reference.field_t);
    if (!(parameters->iron_t > 0.0) || felt->count == 0) {
        return reference;
    }
    for (size_t n = 0; n < felt->count; n++) {
        for (int sensor = 0; sensor < sensors; sensor++) {
            double field_t[3];
            field_of(parameters, sensor, felt->magnet[n], felt->rest[n], field_t);
            for (int axis = 0; axis < 3; axis++) { /* as with the recording's field, axes are assumed orthogonal */
                for (int i = 0; i < 3; i++) {
                    reference.field_t[i] -= parameters->direction[9 * sensor + 3 * axis + i] * field_t[axis] / sensors;
                }
            }
        }
    }
    reference.strength_t = sqrt(dot3(reference.field_t, reference.field_t));
    return reference;
}
