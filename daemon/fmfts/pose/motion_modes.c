/* The two modes of the filter that motion.c explains: what time and a sample do to them, and how they become one state. Of
 * covariances only the upper triangle is kept up to date. */
#include <math.h>
#include <string.h>

#include "model.h"
#include "motion_modes.h"

/* How fast the rates die out while the pad is still. */
#define CALM_S 0.03
/* How often a mode gives way to each other one. */
#define SWITCHES_PER_S 30.0
/* Share of the lasting deviation (gains, places) that counts in each sample. All of it would slow the filter, because
 * noise would seem larger than it is. Without it, wrong gains would look like motion. */
#define LASTING_SHARE 0.5
/* The largest tilt (sine) of a pressed magnet. With a larger one, the filter has lost the magnet. */
#define LARGEST_TILT 0.7

enum { N = FMFTS_MOTION_STATES, RATE = FMFTS_RATE, AMBIENT = FMFTS_AMBIENT_CHANGE, MODES = FMFTS_MODES };
enum { STILL, MOVING };
enum { SEEN = FMFTS_FOLLOWED };
static const int STATE[SEEN] = {0, 1, 2, 3, 4, 10, 11, 12}; /* the states that a sample depends on */

void fmfts_pose_after(const fmfts_pose_parameters *parameters, const double *change, double position[3], double axis[3],
                      double turn[2][3])
{
    const double *rest = parameters->rest + AXIS_VALUE, m = change[3], n = change[4];
    double basis[2][3], upright = sqrt(1.0 - (m * m + n * n));
    tangent_basis(rest, basis);
    for (int i = 0; i < 3; i++) {
        position[i] = parameters->rest[i] + change[i];
        axis[i] = upright * rest[i] + (m * basis[0][i] + n * basis[1][i]);
        turn[0][i] = basis[0][i] - rest[i] * m / upright;
        turn[1][i] = basis[1][i] - rest[i] * n / upright;
    }
}

/* P ← F P Fᵀ for pose += reach·rate, rate *= keeps. */
static void transport(fmfts_mode *own, double reach_s, double keeps)
{
    double(*p)[N] = own->p;
    for (int i = 0; i < RATE; i++) {
        own->x[i] += reach_s * own->x[RATE + i];
        own->x[RATE + i] *= keeps;
        for (int k = i; k < RATE; k++) {
            p[i][k] += reach_s * (p[i][RATE + k] + p[k][RATE + i] + reach_s * p[RATE + i][RATE + k]);
        }
    }
    for (int i = 0; i < RATE; i++) {
        for (int k = 0; k < RATE; k++) {
            p[i][RATE + k] = keeps * (p[i][RATE + k] + reach_s * (i <= k ? p[RATE + i][RATE + k] : p[RATE + k][RATE + i]));
        }
        for (int k = AMBIENT; k < N; k++) {
            p[i][k] += reach_s * p[RATE + i][k];
        }
    }
    for (int i = RATE; i < AMBIENT; i++) {
        for (int k = i; k < N; k++) {
            p[i][k] *= k < AMBIENT ? keeps * keeps : keeps;
        }
    }
}

static void predict(const fmfts_pose_parameters *parameters, double passed_s, const double *drive, fmfts_mode modes[MODES])
{
    double calm = fmfts_exp(-passed_s / CALM_S), square_s2 = passed_s * passed_s;
    double(*p)[N] = modes[MOVING].p;
    transport(&modes[STILL], CALM_S * (1.0 - calm), calm);
    transport(&modes[MOVING], passed_s, 1.0);
    for (int i = 0; i < RATE; i++) {
        for (int k = 0; k < RATE; k++) {
            double power = drive[RATE * i + k];
            p[i][RATE + k] += square_s2 / 2.0 * power;
            if (k >= i) {
                p[i][k] += square_s2 * passed_s / 3.0 * power;
                p[RATE + i][RATE + k] += passed_s * power;
            }
        }
    }
    for (int m = 0; m < MODES; m++) {
        for (int i = 0; i < 3; i++) {
            modes[m].p[AMBIENT + i][AMBIENT + i] += parameters->walk_per_s[AMBIENT_COLUMN + i] * passed_s;
        }
    }
}

/* Takes one scalar measurement. slope: its derivative by STATE. ahead: the prediction. */
static void measure(fmfts_mode *own, double value, double ahead, const double *slope, double r)
{
    double spread[N], s = r;
    for (int i = 0; i < N; i++) {
        spread[i] = 0.0;
    }
    for (int k = 0; k < SEEN; k++) {
        int column = STATE[k];
        for (int i = 0; i <= column; i++) {
            spread[i] += own->p[i][column] * slope[k];
        }
        for (int i = column + 1; i < N; i++) {
            spread[i] += own->p[column][i] * slope[k];
        }
    }
    for (int k = 0; k < SEEN; k++) {
        s += slope[k] * spread[STATE[k]];
    }
    double innovation = value - ahead, inverse = 1.0 / s;
    for (int i = 0; i < N; i++) {
        double gain = spread[i] * inverse;
        own->x[i] += gain * innovation;
        for (int k = i; k < N; k++) {
            own->p[i][k] -= gain * spread[k];
        }
    }
    own->chi2 += innovation * innovation * inverse;
    own->widths *= s / r;
}

static void look_at_magnet(const fmfts_driven *driven, int sensor, const double *x, double ahead[3], double slope[3][SEEN])
{
    const fmfts_pose_parameters *parameters = driven->parameters;
    fmfts_source source = {.strength = driven->strength, .octupole = parameters->octupole_m2};
    fmfts_sight sight;
    double position[3], axis[3];
    fmfts_pose_after(parameters, x, position, axis, source.basis);
    source.position = position;
    source.axis = axis;
    look(&source, parameters->place_m + 3 * sensor, &sight);
    for (int k = 0; k < 3; k++) {
        const double *direction = parameters->direction + 9 * sensor + 3 * k;
        double by_pose[SEEN + 1];
        ahead[k] = sense(&source, &sight, direction, by_pose) + dot3(x + AMBIENT, direction);
        memcpy(slope[k], by_pose, RATE * sizeof(double));
        memcpy(slope[k] + RATE, direction, 3 * sizeof(double));
    }
}

fmfts_driven fmfts_driven_magnet(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *pose, const double *drive)
{
    return (fmfts_driven){
        .parameters = parameters,
        .pose = pose,
        .drive = drive,
        .look = look_at_magnet,
        .strength = parameters->strength_t_m3 * fmfts_exp(pose->state[LOG_VALUE]),
    };
}

/* Takes a chip's sample in one mode. */
static void take(const fmfts_driven *driven, int sensor, const double *value, const double *r, fmfts_mode *own)
{
    double at[SEEN], read[3], slope[3][SEEN];
    driven->look(driven, sensor, own->x, read, slope);
    for (int k = 0; k < SEEN; k++) {
        at[k] = own->x[STATE[k]];
    }
    for (int k = 0; k < 3; k++) {
        double ahead = read[k];
        for (int i = 0; i < SEEN; i++) {
            ahead += slope[k][i] * (own->x[STATE[i]] - at[i]);
        }
        measure(own, value[k], ahead, slope[k], r[k]);
    }
}

/* The field of a sample, baseline subtracted, and the variance of its errors. */
static void read_sample(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *pose, const fmfts_early *sample,
                        double value[3], double r[3])
{
    double change[3];
    for (int k = 0; k < 3; k++) {
        int axis = 3 * sample->sensor + k;
        value[k] = sample->field_t[k] / parameters->gain[axis] - parameters->offset_t[axis];
        change[k] = value[k] - parameters->rest_field_t[axis];
    }
    for (int k = 0; k < 3; k++) {
        int axis = 3 * sample->sensor + k;
        double noise = parameters->noise_t[axis];
        r[k] = noise * noise + LASTING_SHARE * LASTING_SHARE * fmfts_lasting_variance(parameters, pose, axis, change);
    }
}

bool fmfts_is_upright(const double *x)
{
    return x[3] * x[3] + x[4] * x[4] < LARGEST_TILT * LARGEST_TILT;
}

bool fmfts_take_sample(const fmfts_driven *driven, const fmfts_early *sample, fmfts_mode modes[MODES],
                       fmfts_motion_memory *memory)
{
    const fmfts_pose_parameters *parameters = driven->parameters;
    double value[3], r[3], time_us = (double)sample->time_us, passed_s = (time_us - memory->motion_us) * 1e-6;
    if (passed_s > 0.0) {
        predict(parameters, passed_s, driven->drive, modes);
        memory->motion_us = time_us;
    }
    read_sample(parameters, driven->pose, sample, value, r);
    for (int m = 0; m < MODES; m++) {
        if (!fmfts_is_upright(modes[m].x)) {
            return false;
        }
        take(driven, sample->sensor, value, r, &modes[m]);
    }
    return true;
}

/* After a long gap all modes are equally likely. shares: the modes' probabilities after the
 * last frame. */
static void merge_modes(const fmfts_motion_parameters *own, double elapsed_s, const fmfts_mode *modes, const double *shares,
                        double probability[MODES])
{
    double likelihood[MODES], best = -INFINITY, sum = 0.0, before = 0.0;
    double leaves = fmin(1.0 - fmfts_exp(-SWITCHES_PER_S * elapsed_s), 1.0 / MODES), stays = 1.0 - (MODES - 1) * leaves;
    for (int m = 0; m < MODES; m++) {
        likelihood[m] = -0.5 * (modes[m].chi2 + fmfts_log(modes[m].widths));
        best = fmax(best, likelihood[m]);
        before += shares[m];
    }
    for (int m = 0; m < MODES; m++) {
        double arrived = leaves * (before - shares[m]) + stays * shares[m];
        probability[m] = arrived * own->weights[m] * fmfts_exp(likelihood[m] - best);
        sum += probability[m];
    }
    for (int m = 0; m < MODES; m++) {
        probability[m] /= sum;
    }
}

/* Merges the modes, with these probabilities, into one state: its mean, and its covariance with the spread of the
 * modes. */
static void merge_states(const fmfts_mode modes[MODES], fmfts_motion_memory *memory)
{
    for (int i = 0; i < N; i++) {
        memory->motion_state[i] = 0.0;
        for (int m = 0; m < MODES; m++) {
            memory->motion_state[i] += memory->modes[m] * modes[m].x[i];
        }
    }
    memset(memory->motion_covariance, 0, sizeof memory->motion_covariance);
    for (int m = 0; m < MODES; m++) {
        double off[N];
        for (int i = 0; i < N; i++) {
            off[i] = modes[m].x[i] - memory->motion_state[i];
        }
        for (int i = 0; i < N; i++) {
            for (int k = i; k < N; k++) {
                memory->motion_covariance[N * i + k] += memory->modes[m] * (modes[m].p[i][k] + off[i] * off[k]);
            }
        }
    }
    for (int i = 1; i < N; i++) {
        for (int k = 0; k < i; k++) {
            memory->motion_covariance[N * i + k] = memory->motion_covariance[N * k + i];
        }
    }
}

void fmfts_merge(const fmfts_motion_parameters *own, double elapsed_s, const fmfts_mode *modes, const double *shares,
                 fmfts_motion_memory *memory)
{
    merge_modes(own, elapsed_s, modes, shares, memory->modes);
    merge_states(modes, memory);
}
