#include "beside.h"

#include <math.h>
#include <string.h>

#include "../arithmetic/matrix.h"
#include "limits.h"
#include "model.h"

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

/* Multiplies the six values of a step by `turn`. apart: their distance in doubles. */
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

fmfts_sighting fmfts_view_sighting(double *doubles, size_t magnets)
{
    double *covariance = doubles + FMFTS_PLACED * magnets, *time_ns = covariance + FMFTS_MOVES * FMFTS_MOVES * magnets * magnets;
    double *rest = time_ns + 1;
    return (fmfts_sighting){magnets, doubles, covariance, time_ns, rest, rest + FMFTS_PLACED * magnets};
}

/* The covariance of the magnets, turned to this pad's axes. */
static void turn_covariance(const double turn[9], const fmfts_sighting *sighting, const fmfts_seen *seen)
{
    size_t columns = FMFTS_MOVES * sighting->magnets;
    for (size_t i = 0; i < columns; i++) {
        memcpy(seen->covariance + seen->width * i, sighting->covariance + columns * i, columns * sizeof(double));
    }
    for (size_t m = 0; m < sighting->magnets; m++) {
        double steps[FMFTS_MOVES][FMFTS_MOVES];
        turn_steps(turn, sighting->last + FMFTS_PLACED * m + AXIS_VALUE, seen->now[m] + AXIS_VALUE, steps);
        for (size_t i = 0; i < columns; i++) {
            turn_six((const double(*)[FMFTS_MOVES])steps, seen->covariance + seen->width * FMFTS_MOVES * m + i, seen->width);
        }
        for (size_t i = 0; i < columns; i++) {
            turn_six((const double(*)[FMFTS_MOVES])steps, seen->covariance + seen->width * i + FMFTS_MOVES * m, 1);
        }
    }
}

/* Widens it by the time since the magnets were seen. age_s: NaN if they never were. */
static void widen_by_age(double age_s, size_t magnets, const fmfts_seen *seen)
{
    double moved_m = isnan(age_s) ? FMFTS_REACH_M : fmin(FMFTS_SPEED_M_PER_S * age_s, FMFTS_REACH_M);
    double turned_rad = isnan(age_s) ? FMFTS_REACH_RAD : fmin(FMFTS_TURN_RAD_PER_S * age_s, FMFTS_REACH_RAD);
    for (size_t c = 0; c < FMFTS_MOVES * magnets; c++) {
        size_t i = c % FMFTS_MOVES;
        double moved = i < TILT_COLUMN ? moved_m : i < LOG_COLUMN ? turned_rad : FMFTS_MOMENT_DEVIATION;
        seen->covariance[(seen->width + 1) * c] += moved * moved;
    }
}

void fmfts_see(const double turn[9], const double place_m[3], const fmfts_sighting *sighting, double time_ns,
               const fmfts_seen *seen)
{
    for (size_t m = 0; m < sighting->magnets; m++) {
        place(turn, place_m, sighting->rest + FMFTS_PLACED * m, seen->rest[m]);
        place(turn, place_m, sighting->last + FMFTS_PLACED * m, seen->now[m]);
    }
    turn_covariance(turn, sighting, seen);
    widen_by_age(fabs(time_ns - *sighting->time_ns) * 1e-9, sighting->magnets, seen);
}

static fmfts_source source_of(const double magnet[FMFTS_MAGNET], const double placed[FMFTS_PLACED])
{
    fmfts_source source = {.position = placed,
                           .axis = placed + AXIS_VALUE,
                           .strength = magnet[0] * fmfts_exp(placed[LOG_VALUE]),
                           .octupole = magnet[1]};
    return source;
}

void fmfts_field_of_placed(const double magnet[FMFTS_MAGNET], const double placed[FMFTS_PLACED], const double place_m[3],
                           const double direction[9], double field_t[3])
{
    double in_pad_axes_t[3];
    fmfts_sight sight;
    fmfts_source source = source_of(magnet, placed);
    look(&source, place_m, &sight);
    dipole_field(&source, &sight, in_pad_axes_t);
    turn3(direction, in_pad_axes_t, field_t);
}

double fmfts_placement_variance(const double rest_error[2], double placement_m, const double now_m[3], const double place_m[3],
                                const double change_t[3])
{
    double away_m[3];
    for (int i = 0; i < 3; i++) {
        away_m[i] = place_m[i] - now_m[i];
    }
    double distance_m = sqrt(dot3(away_m, away_m)), share = rest_error[1];
    double by_placement = 4.0 * placement_m / distance_m, by_rest = 4.0 * rest_error[0] / distance_m;
    return dot3(change_t, change_t) * (by_placement * by_placement + by_rest * by_rest + share * share) / 3.0;
}

void fmfts_change_beside(const fmfts_beside *pad, double *rest_t, double *change_t, double *covariance_t2)
{
    enum { COLUMNS = FMFTS_MOVES * FMFTS_MOST_TOGETHER };
    double slope[FMFTS_AXES * COLUMNS], spread[FMFTS_AXES * COLUMNS], turned[COLUMNS * FMFTS_AXES], variance_t2[FMFTS_SENSORS];
    size_t columns = FMFTS_MOVES * pad->magnets, axes = 3 * pad->sensors;
    memset(rest_t, 0, axes * sizeof(double));
    memset(change_t, 0, axes * sizeof(double));
    memset(variance_t2, 0, sizeof variance_t2);
    for (size_t m = 0; m < pad->magnets; m++) {
        const double *rest = pad->rest + FMFTS_PLACED * m, *now = pad->now + FMFTS_PLACED * m, *magnet = pad->magnet + FMFTS_MAGNET * m;
        fmfts_source source = source_of(magnet, now);
        tangent_basis(source.axis, source.basis);
        for (size_t sensor = 0; sensor < pad->sensors; sensor++) {
            const double *place_m = pad->place_m + 3 * sensor, *direction = pad->direction + 9 * sensor;
            double before_t[3], since_t[3];
            fmfts_sight sight;
            fmfts_field_of_placed(magnet, rest, place_m, direction, before_t);
            fmfts_field_of_placed(magnet, now, place_m, direction, since_t);
            look(&source, place_m, &sight);
            for (size_t i = 0; i < 3; i++) {
                rest_t[3 * sensor + i] += before_t[i];
                since_t[i] -= before_t[i];
                change_t[3 * sensor + i] += since_t[i];
                sense(&source, &sight, direction + 3 * i, slope + (3 * sensor + i) * columns + FMFTS_MOVES * m);
            }
            variance_t2[sensor] += fmfts_placement_variance(pad->rest_error + 2 * m, pad->placement_m, now, place_m, since_t);
        }
    }
    for (size_t i = 0; i < axes; i++) {
        for (size_t c = 0; c < columns; c++) {
            turned[c * axes + i] = slope[i * columns + c];
        }
    }
    fmfts_product(axes, columns, columns, slope, pad->covariance, spread);
    fmfts_product(axes, columns, axes, spread, turned, covariance_t2);
    for (size_t i = 0; i < axes; i++) {
        covariance_t2[(axes + 1) * i] += variance_t2[i / 3];
    }
}
