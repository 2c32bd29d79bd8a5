/* The magnets of neighbouring pads, which are unknowns beside the pad's own. Their prior is where their own pad saw them last.
 *
 * The baseline already subtracts the field of the neighbours at rest. Their modelled field at rest is therefore added again,
 * and the solve models the magnets where they are now: only the change between the two counts.
 */
#include <math.h>
#include <string.h>

#include "limits.h"
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

/* A magnet's place and axis, from its own pad's axes to this one's. */
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

/* Multiplies the six values of a step, which stand `apart` doubles apart, by `turn`. */
static void turn_six(const double turn[FMFTS_MOVES][FMFTS_MOVES], double *values, size_t apart)
{
    double before[FMFTS_MOVES];
    for (size_t i = 0; i < FMFTS_MOVES; i++) {
        before[i] = values[apart * i];
    }
    for (size_t i = 0; i < FMFTS_MOVES; i++) {
        double sum = 0.0;
        for (size_t k = 0; k < FMFTS_MOVES; k++) {
            sum += turn[i][k] * before[k];
        }
        values[apart * i] = sum;
    }
}

/* Where one neighbouring pad's magnets stand among all that are felt: the first one, how many, and the width of the covariance
 * of all. */
typedef struct {
    size_t first, magnets, width;
} range;

/* The covariance of one pad's magnets, turned to this pad's axes. */
static void turn_covariance(const double rotation[9], const fmfts_sighting *seen, range own, fmfts_felt *felt)
{
    size_t columns = FMFTS_MOVES * own.magnets;
    double *block = felt->covariance + (own.width + 1) * FMFTS_MOVES * own.first;
    for (size_t i = 0; i < columns; i++) {
        memcpy(block + own.width * i, seen->covariance + columns * i, columns * sizeof(double));
    }
    for (size_t m = 0; m < own.magnets; m++) {
        double turn[FMFTS_MOVES][FMFTS_MOVES];
        turn_steps(rotation, seen->last + FMFTS_PLACED * m + AXIS_VALUE, felt->now[own.first + m] + AXIS_VALUE, turn);
        for (size_t i = 0; i < columns; i++) {
            turn_six((const double(*)[FMFTS_MOVES])turn, block + own.width * FMFTS_MOVES * m + i, own.width);
        }
        for (size_t i = 0; i < columns; i++) {
            turn_six((const double(*)[FMFTS_MOVES])turn, block + own.width * i + FMFTS_MOVES * m, 1);
        }
    }
}

/* Widens it by the time since the magnets were seen. age_s: NaN if they never were. */
static void widen_by_age(double age_s, range own, fmfts_felt *felt)
{
    double moved_m = isnan(age_s) ? FMFTS_REACH_M : fmin(FMFTS_SPEED_M_PER_S * age_s, FMFTS_REACH_M);
    double turned_rad = isnan(age_s) ? FMFTS_REACH_RAD : fmin(FMFTS_TURN_RAD_PER_S * age_s, FMFTS_REACH_RAD);
    for (size_t c = FMFTS_MOVES * own.first; c < FMFTS_MOVES * (own.first + own.magnets); c++) {
        size_t i = c % FMFTS_MOVES;
        double moved = i < TILT_COLUMN ? moved_m : i < LOG_COLUMN ? turned_rad : FMFTS_MOMENT_DEVIATION;
        felt->covariance[(own.width + 1) * c] += moved * moved;
    }
}

static void feel_pad(const fmfts_pose_parameters *parameters, size_t pad, const fmfts_sighting *seen, range own,
                     fmfts_felt *felt)
{
    const double *rotation = parameters->neighbour_turn + 9 * pad, *place_m = parameters->neighbour_place_m + 3 * pad;
    for (size_t m = 0; m < own.magnets; m++) {
        size_t n = own.first + m;
        memcpy(felt->magnet[n], parameters->neighbour_magnet + FMFTS_MAGNET * n, sizeof felt->magnet[n]);
        memcpy(felt->rest_error[n], seen->rest_error + 2 * m, sizeof felt->rest_error[n]);
        felt->placement_m[n] = parameters->neighbour_placement_m[pad];
        place(rotation, place_m, seen->rest + FMFTS_PLACED * m, felt->rest[n]);
        place(rotation, place_m, seen->last + FMFTS_PLACED * m, felt->now[n]);
    }
    turn_covariance(rotation, seen, own, felt);
}

/* The field at a sensor, along its own axes, of a neighbour's magnet at `placed`. */
static void field_of(const fmfts_pose_parameters *parameters, int sensor, const double magnet[FMFTS_MAGNET],
                     const double placed[FMFTS_PLACED], double field_t[3])
{
    double in_pad_axes_t[3];
    fmfts_sight sight;
    fmfts_source source = {.position = placed,
                           .axis = placed + AXIS_VALUE,
                           .strength = magnet[0] * fmfts_exp(placed[LOG_VALUE]),
                           .octupole = magnet[1]};
    look(&source, parameters->place_m + 3 * sensor, &sight);
    for (int i = 0; i < 3; i++) {
        in_pad_axes_t[i] = sight.alpha * source.axis[i] + sight.beta * sight.r[i];
    }
    for (int axis = 0; axis < 3; axis++) {
        field_t[axis] = dot3(parameters->direction + 9 * sensor + 3 * axis, in_pad_axes_t);
    }
}

/* The variance at one sensor, along each axis, from errors of a magnet's placement and of its rest: a dipole's change of field
 * varies by 4/r of itself per metre. change_t: of the field there, since the magnet rested. */
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
            variance_t2 += placement_variance(felt, n, parameters->place_m + 3 * sensor, change_t);
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
    range own = {.first = 0, .width = FMFTS_MOVES * felt->count};
    memset(felt->covariance, 0, own.width * own.width * sizeof(double));
    for (size_t pad = 0; pad < pads; pad++) {
        own.magnets = seen[pad].magnets;
        feel_pad(parameters, pad, &seen[pad], own, felt);
        widen_by_age(fabs(time_ns - *seen[pad].time_ns) * 1e-9, own, felt);
        own.first += own.magnets;
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

/* A neighbour turns along with the robot: the bare recording has taken its field for the Earth's. */
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
            for (int axis = 0; axis < 3; axis++) { /* to the pad's axes as the recording's field: as if axes were orthogonal */
                for (int i = 0; i < 3; i++) {
                    reference.field_t[i] -= parameters->direction[9 * sensor + 3 * axis + i] * field_t[axis] / sensors;
                }
            }
        }
    }
    reference.strength_t = sqrt(dot3(reference.field_t, reference.field_t));
    return reference;
}
