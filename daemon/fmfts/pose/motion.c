/* The filter of motion.py. Of covariances only the upper triangle is kept up to date. */
#include "motion.h"

#include <math.h>
#include <string.h>

#include "model.h"

enum { N = FMFTS_MOTION_STATES, RATE = FMFTS_RATE, AMBIENT = FMFTS_AMBIENT_CHANGE };
enum { STILL, MOVING, MODES };
enum { SEEN = 8 };
static const int STATE[SEEN] = {0, 1, 2, 3, 4, 10, 11, 12}; /* what a sample depends on */

/* chi2: sum of ν²/s. widths: product of s/r. */
typedef struct {
    double x[N], p[N][N], chi2, widths;
} mode;

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
static void transport(mode *own, double reach_s, double keeps)
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

static void predict(const fmfts_pose_parameters *parameters, const fmfts_motion_parameters *own, double passed_s,
                    const double *drive, mode modes[MODES])
{
    double calm = fmfts_exp(-passed_s / own->calm_s[0]), square_s2 = passed_s * passed_s;
    double(*p)[N] = modes[MOVING].p;
    transport(&modes[STILL], own->calm_s[0] * (1.0 - calm), calm);
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

/* Takes one scalar: motion.py's _measure. slope: by STATE. ahead: what the axis would read. */
static void measure(mode *own, double value, double ahead, const double *slope, double r)
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

/* Takes a chip's sample in one mode. */
static void take(const fmfts_pose_parameters *parameters, int sensor, double strength, const double *value, const double *r,
                 mode *own)
{
    fmfts_source source = {.strength = strength, .octupole = parameters->octupole_m2[0]};
    fmfts_sight sight;
    double position[3], axis[3], at[SEEN];
    fmfts_pose_after(parameters, own->x, position, axis, source.basis);
    source.position = position;
    source.axis = axis;
    look(&source, parameters->place_m + 3 * sensor, &sight);
    for (int k = 0; k < SEEN; k++) {
        at[k] = own->x[STATE[k]];
    }
    for (int k = 0; k < 3; k++) {
        const double *direction = parameters->direction + 9 * sensor + 3 * k;
        double slope[SEEN + 1], ahead = sense(&source, &sight, direction, slope) + dot3(at + RATE, direction);
        memcpy(slope + RATE, direction, 3 * sizeof(double));
        for (int i = 0; i < SEEN; i++) {
            ahead += slope[i] * (own->x[STATE[i]] - at[i]);
        }
        measure(own, value[k], ahead, slope, r[k]);
    }
}

/* The field of a sensor's sample (field_t [3], as measured), baseline subtracted, and the variance of its errors. */
static void read_sample(const fmfts_pose_parameters *parameters, const fmfts_motion_parameters *own,
                        const fmfts_pose_memory *pose, int sensor, const double *field_t, double value[3], double r[3])
{
    double change[3];
    for (int k = 0; k < 3; k++) {
        int axis = 3 * sensor + k;
        value[k] = field_t[k] / parameters->gain[axis] - parameters->offset_t[axis];
        change[k] = value[k] - parameters->rest_field_t[axis];
    }
    for (int k = 0; k < 3; k++) {
        int axis = 3 * sensor + k;
        double noise = parameters->noise_t[axis];
        r[k] = noise * noise + own->lasting_share[0] * own->lasting_share[0] *
                                   fmfts_lasting_variance(parameters, pose, axis, change);
    }
}

static bool is_upright(const fmfts_motion_parameters *own, const double *x)
{
    return x[3] * x[3] + x[4] * x[4] < own->largest_tilt[0] * own->largest_tilt[0];
}

/* shares: the modes' probabilities after the last frame. */
static void merge(const fmfts_motion_parameters *own, double elapsed_s, const mode modes[MODES], const double *shares,
                  fmfts_motion_memory *memory)
{
    double likelihood[MODES], best = -INFINITY, share[MODES], sum = 0.0, before = 0.0;
    double leaves = fmin(1.0 - fmfts_exp(-own->switches_per_s[0] * elapsed_s), 1.0 / MODES), stays = 1.0 - (MODES - 1) * leaves;
    for (int m = 0; m < MODES; m++) {
        likelihood[m] = -0.5 * (modes[m].chi2 + fmfts_log(modes[m].widths));
        best = fmax(best, likelihood[m]);
        before += shares[m];
    }
    for (int m = 0; m < MODES; m++) {
        double arrived = leaves * (before - shares[m]) + stays * shares[m];
        share[m] = arrived * own->weights[m] * fmfts_exp(likelihood[m] - best);
        sum += share[m];
    }
    for (int m = 0; m < MODES; m++) {
        memory->modes[m] = share[m] / sum;
    }
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

static bool had_early(const fmfts_pose_parameters *parameters, const fmfts_motion_memory *memory)
{
    for (int i = 0; i < (int)parameters->sensors[0]; i++) {
        if (memory->early_us[i] != 0.0) {
            return true;
        }
    }
    return false;
}

/* The modes since the last frame: those of the samples that came before their frame, or else the merged state. shares: their
 * probabilities after that frame. Returns the time of its newest sample. */
static double begin_modes(const fmfts_pose_parameters *parameters, const fmfts_motion_memory *memory, mode modes[MODES],
                          double shares[MODES])
{
    bool goes_on = had_early(parameters, memory);
    for (int m = 0; m < MODES; m++) {
        const double *x = goes_on ? memory->early_state + N * m : memory->motion_state;
        memcpy(modes[m].x, x, sizeof modes[m].x);
        memcpy(modes[m].p, goes_on ? memory->early_covariance + N * N * m : memory->motion_covariance, sizeof modes[m].p);
        modes[m].chi2 = goes_on ? memory->early_chi2_sum[m] : 0.0;
        modes[m].widths = goes_on ? memory->early_widths[m] : 1.0;
        shares[m] = goes_on ? memory->early_modes[m] : memory->modes[m];
    }
    return goes_on ? memory->early_from_us[0] : memory->motion_us[0];
}

/* Takes a sensor's sample in every mode. False if a mode is lost. */
static bool take_sample(const fmfts_pose_parameters *parameters, const fmfts_motion_parameters *own,
                        const fmfts_pose_memory *pose, int sensor, const double *field_t, double time_us,
                        const double *drive, mode modes[MODES], fmfts_motion_memory *memory)
{
    double value[3], r[3], passed_s = (time_us - memory->motion_us[0]) * 1e-6;
    double strength = parameters->strength_t_m3[0] * fmfts_exp(pose->state[LOG_VALUE]);
    if (passed_s > 0.0) {
        predict(parameters, own, passed_s, drive, modes);
        memory->motion_us[0] = time_us;
    }
    read_sample(parameters, own, pose, sensor, field_t, value, r);
    for (int m = 0; m < MODES; m++) {
        if (!is_upright(own, modes[m].x)) {
            return false;
        }
        take(parameters, sensor, strength, value, r, &modes[m]);
    }
    return true;
}

bool fmfts_is_next(const fmfts_motion_parameters *own, const fmfts_motion_memory *memory, int sensor, double time_us)
{
    return memory->motion_us[0] > 0.0 && time_us > fmax(memory->early_us[sensor], memory->motion_us[0] - own->late_us[0]);
}

static const double *newest_of(const double *time_us, int sensors)
{
    const double *newest = time_us;
    for (int i = 1; i < sensors; i++) {
        newest = time_us[i] > *newest ? time_us + i : newest;
    }
    return newest;
}

static int oldest_of(const fmfts_pose_memory *pose, unsigned left, int sensors)
{
    int oldest = -1;
    for (int i = 0; i < sensors; i++) {
        oldest = (left >> i & 1) && (oldest < 0 || pose->time_us[i] < pose->time_us[oldest]) ? i : oldest;
    }
    return oldest;
}

bool fmfts_follow(const fmfts_pose_parameters *parameters, const fmfts_motion_parameters *own,
                  const fmfts_pose_memory *pose, unsigned fresh, const double *drive, fmfts_motion_memory *memory)
{
    mode modes[MODES];
    int sensors = (int)parameters->sensors[0];
    double shares[MODES], newest_us = memory->motion_us[0], chi2 = INFINITY;
    bool early = had_early(parameters, memory);
    if (!(memory->motion_us[0] > 0.0)) {
        return false;
    }
    fresh &= (1u << sensors) - 1;
    if (early && *newest_of(pose->time_us, sensors) <= memory->motion_us[0] - own->late_us[0]) {
        return false; /* an old frame, sent again */
    }
    for (int i = 0; early && i < sensors; i++) {
        fresh &= ~((unsigned)!fmfts_is_next(own, memory, i, pose->time_us[i]) << i);
    }
    if (!fresh && !early) {
        return true;
    }
    double from_us = begin_modes(parameters, memory, modes, shares);
    while (fresh) {
        int sensor = oldest_of(pose, fresh, sensors);
        fresh &= ~(1u << sensor);
        newest_us = pose->time_us[sensor];
        if (!take_sample(parameters, own, pose, sensor, pose->field_t + 3 * sensor, newest_us, drive, modes, memory)) {
            return false;
        }
    }
    merge(own, fmax(newest_us - from_us, 0.0) * 1e-6, modes, shares, memory);
    memory->followed[0] += 1.0;
    memset(memory->early_us, 0, sizeof memory->early_us);
    for (int m = 0; m < MODES; m++) {
        chi2 = fmin(chi2, modes[m].chi2);
    }
    return chi2 < own->surprise_chi2[0] && is_upright(own, memory->motion_state);
}

bool fmfts_follow_early(const fmfts_pose_parameters *parameters, const fmfts_motion_parameters *own,
                        const fmfts_pose_memory *pose, int sensor, const double *field_t, double time_us,
                        const double *drive, fmfts_motion_memory *memory)
{
    mode modes[MODES];
    double shares[MODES], before[MODES], from_us = begin_modes(parameters, memory, modes, shares);
    double chi2 = INFINITY, step_chi2 = INFINITY;
    for (int m = 0; m < MODES; m++) {
        before[m] = modes[m].chi2;
    }
    if (!take_sample(parameters, own, pose, sensor, field_t, time_us, drive, modes, memory)) {
        return false;
    }
    merge(own, fmax(time_us - from_us, 0.0) * 1e-6, modes, shares, memory);
    memory->early_us[sensor] = time_us;
    memory->early_from_us[0] = from_us;
    for (int m = 0; m < MODES; m++) {
        memory->early_modes[m] = shares[m];
        memcpy(memory->early_state + N * m, modes[m].x, sizeof modes[m].x);
        memcpy(memory->early_covariance + N * N * m, modes[m].p, sizeof modes[m].p);
        memory->early_chi2_sum[m] = modes[m].chi2;
        memory->early_widths[m] = modes[m].widths;
        chi2 = fmin(chi2, modes[m].chi2);
        step_chi2 = fmin(step_chi2, modes[m].chi2 - before[m]);
    }
    return step_chi2 < own->early_chi2[0] && chi2 < own->surprise_chi2[0] && is_upright(own, memory->motion_state);
}
