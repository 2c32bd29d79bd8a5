/* The magnets of neighbouring pads, which are unknowns beside the pad's own: neighbour.py. */
#include <math.h>
#include <string.h>

#include "model.h"
#include "step.h"

enum { TILTS = 2 };

/* out = m·v */
static void turn3(const double m[9], const double v[3], double out[3])
{
    for (int i = 0; i < 3; i++) {
        out[i] = dot3(m + 3 * i, v);
    }
}

/* A magnet's place and axis, from its own pad's axes to this one's: NeighbourView._placed. */
static void place(const double rotation[9], const double place_m[3], const double from[FMFTS_PLACED], double to[FMFTS_PLACED])
{
    turn3(rotation, from, to);
    for (int i = 0; i < 3; i++) {
        to[i] += place_m[i];
    }
    turn3(rotation, from + AXIS_VALUE, to + AXIS_VALUE);
    to[LOG_VALUE] = from[LOG_VALUE];
}

/* How a step from `there` looks from `here`: the rotation, for position and for the tilts between tangent planes. */
static void turn_steps(const double rotation[9], const double there[3], const double here[3],
                       double turn[FMFTS_MOVES][FMFTS_MOVES])
{
    double before[TILTS][3], after[TILTS][3], turned[3];
    tangent_basis(there, before);
    tangent_basis(here, after);
    memset(turn, 0, FMFTS_MOVES * sizeof turn[0]);
    for (int i = 0; i < 3; i++) {
        memcpy(turn[i], rotation + 3 * i, 3 * sizeof(double));
    }
    for (int j = 0; j < TILTS; j++) {
        turn3(rotation, before[j], turned);
        for (int i = 0; i < TILTS; i++) {
            turn[TILT_COLUMN + i][TILT_COLUMN + j] = dot3(after[i], turned);
        }
    }
    turn[LOG_COLUMN][LOG_COLUMN] = 1.0;
}

/* out = T·C·Tᵀ */
static void turn_covariance(const double turn[FMFTS_MOVES][FMFTS_MOVES], const double *covariance,
                            double out[FMFTS_MOVES][FMFTS_MOVES])
{
    double half[FMFTS_MOVES][FMFTS_MOVES];
    for (int i = 0; i < FMFTS_MOVES; i++) {
        for (int j = 0; j < FMFTS_MOVES; j++) {
            half[i][j] = 0.0;
            for (int k = 0; k < FMFTS_MOVES; k++) {
                half[i][j] += turn[i][k] * covariance[FMFTS_MOVES * k + j];
            }
        }
    }
    for (int i = 0; i < FMFTS_MOVES; i++) {
        for (int j = 0; j < FMFTS_MOVES; j++) {
            out[i][j] = 0.0;
            for (int k = 0; k < FMFTS_MOVES; k++) {
                out[i][j] += half[i][k] * turn[j][k];
            }
        }
    }
}

void fmfts_feel(const fmfts_pose_parameters *parameters, const fmfts_sighting *const *seen, double time_ns, fmfts_felt *felt)
{
    felt->count = (size_t)parameters->neighbours[0];
    for (size_t n = 0; n < felt->count; n++) {
        const double *rotation = parameters->neighbour_turn + 9 * n, *place_m = parameters->neighbour_place_m + 3 * n;
        double turn[FMFTS_MOVES][FMFTS_MOVES], age_s = fabs(time_ns - seen[n]->time_ns[0]) * 1e-9;
        bool was_seen = !isnan(age_s);
        double moved_m = was_seen ? fmin(parameters->speed_m_per_s[0] * age_s, parameters->farthest_m[0]) : parameters->farthest_m[0];
        double turned_rad =
            was_seen ? fmin(parameters->turn_rad_per_s[0] * age_s, parameters->farthest_rad[0]) : parameters->farthest_rad[0];
        memcpy(felt->magnet[n], parameters->neighbour_magnet + FMFTS_MAGNET * n, sizeof felt->magnet[n]);
        place(rotation, place_m, seen[n]->rest, felt->rest[n]);
        place(rotation, place_m, seen[n]->last, felt->now[n]);
        turn_steps(rotation, seen[n]->last + AXIS_VALUE, felt->now[n] + AXIS_VALUE, turn);
        turn_covariance((const double(*)[FMFTS_MOVES])turn, seen[n]->covariance, felt->covariance[n]);
        for (int i = 0; i < FMFTS_MOVES; i++) {
            double moved = i < 3 ? moved_m : i < 3 + TILTS ? turned_rad : parameters->moment_deviation[0];
            felt->covariance[n][i][i] += moved * moved;
        }
        memcpy(felt->rest_error[n], seen[n]->rest_error, sizeof felt->rest_error[n]);
        felt->placement_m[n] = parameters->neighbour_placement_m[n];
    }
}

/* The field in the pad's axes at a sensor of a neighbour's magnet at `placed`: dipole_field. */
static void field_of(const double magnet[FMFTS_MAGNET], const double placed[FMFTS_PLACED], const double *sensor_m,
                     double field_t[3])
{
    fmfts_sight sight;
    fmfts_source source = {.position = placed,
                           .axis = placed + AXIS_VALUE,
                           .strength = magnet[0] * fmfts_exp(placed[LOG_VALUE]),
                           .octupole = magnet[1]};
    look(&source, sensor_m, &sight);
    for (int i = 0; i < 3; i++) {
        field_t[i] = sight.alpha * source.axis[i] + sight.beta * sight.r[i];
    }
}

/* NeighbourEstimate.placement_variance at one sensor. change_t: of the field there, since the neighbour rested. */
static double placement_variance(const fmfts_felt *felt, size_t n, const double *sensor_m, const double change_t[3])
{
    double away_m[3];
    for (int i = 0; i < 3; i++) {
        away_m[i] = sensor_m[i] - felt->now[n][i];
    }
    double distance_m = sqrt(dot3(away_m, away_m)), share = felt->rest_error[n][1];
    double by_placement = 4.0 * felt->placement_m[n] / distance_m, by_rest = 4.0 * felt->rest_error[n][0] / distance_m;
    return dot3(change_t, change_t) * (by_placement * by_placement + by_rest * by_rest + share * share) / 3.0;
}

void fmfts_add_neighbours(const fmfts_pose_parameters *parameters, const fmfts_felt *felt, fmfts_field *field)
{
    for (int sensor = 0; sensor < (int)parameters->sensors[0]; sensor++) {
        const double *sensor_m = parameters->place_m + 3 * sensor;
        double added_t[3] = {0.0}, variance_t2 = 0.0;
        for (size_t n = 0; n < felt->count; n++) {
            double rest_t[3], change_t[3];
            field_of(felt->magnet[n], felt->rest[n], sensor_m, rest_t);
            field_of(felt->magnet[n], felt->now[n], sensor_m, change_t);
            for (int i = 0; i < 3; i++) {
                added_t[i] += rest_t[i];
                change_t[i] -= rest_t[i];
            }
            variance_t2 += placement_variance(felt, n, sensor_m, change_t);
        }
        for (int axis = 3 * sensor; axis < 3 * sensor + 3; axis++) {
            field->field_t[axis] += dot3(parameters->direction + 3 * axis, added_t);
            field->other_t2[axis] += variance_t2;
            field->variance_t2[axis] += variance_t2;
        }
    }
}

void fmfts_take_neighbours(const fmfts_pose_parameters *parameters, const fmfts_felt *felt, const double placed[][FMFTS_PLACED],
                           fmfts_field *field)
{
    for (int sensor = 0; sensor < (int)parameters->sensors[0]; sensor++) {
        double sum_t[3] = {0.0};
        for (size_t n = 0; n < felt->count; n++) {
            double field_t[3];
            field_of(felt->magnet[n], placed[n], parameters->place_m + 3 * sensor, field_t);
            for (int i = 0; i < 3; i++) {
                sum_t[i] += field_t[i];
            }
        }
        for (int axis = 3 * sensor; felt->count && axis < 3 * sensor + 3; axis++) {
            field->field_t[axis] -= dot3(parameters->direction + 3 * axis, sum_t);
        }
    }
}

fmfts_reference fmfts_reference_beside(const fmfts_pose_parameters *parameters, const fmfts_felt *felt)
{
    fmfts_reference reference = {.strength_t = parameters->reference_strength_t[0]};
    int sensors = (int)parameters->sensors[0];
    memcpy(reference.field_t, parameters->reference_t, sizeof reference.field_t);
    if (!(parameters->iron_t[0] > 0.0) || felt->count == 0) {
        return reference;
    }
    for (size_t n = 0; n < felt->count; n++) {
        for (int sensor = 0; sensor < sensors; sensor++) {
            double field_t[3];
            field_of(felt->magnet[n], felt->rest[n], parameters->place_m + 3 * sensor, field_t);
            for (int i = 0; i < 3; i++) {
                reference.field_t[i] -= field_t[i] / sensors;
            }
        }
    }
    reference.strength_t = sqrt(dot3(reference.field_t, reference.field_t));
    return reference;
}
