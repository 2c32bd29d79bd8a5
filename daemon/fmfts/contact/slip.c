/* The place of a finger if it sticks, and if it moves: parallel extended Kalman filters.
 *
 * Shear of a sticking finger moves the magnet and not the place; a finger that slips moves the place. Each filter explains a change of
 * pose by the pad's response to place (mm), force and shear (N). friction.c compares them.
 *
 *     STUCK: the place stays. A shear shifts the pressure under the finger, and so the place that the pad sees. An error of the
 *            pose that lasts (the baseline's, a field that has turned) shifts it the more the lighter the press is:
 *            seen = place + (lever·shear + offset)/force
 *            with a lever (mm) and an offset (mm N) that the filter learns in each touch
 *     SLOW, FAST: the place has a velocity that comes and goes: v ← e·v, var v ← e²·var v + (1 − e²)·SPEED², ln e = −dt/LASTS_S
 *
 * State x (9): place (2), force, shear (2), and velocity (2, mm/s) or the lever, and the offset (2). Between frames
 * P += diag(walk²)·dt. The change of pose z, whitened by the noise's factor L (R = L·Lᵀ), is five scalar measurements
 * with h, its derivative by x:
 *
 *     s = hPhᵀ + 1,  ν = z − ẑ,  x += Phᵀν/s,  P −= Phᵀ(Phᵀ)ᵀ/s,  log likelihood −= (ν²/s + ln s)/2
 *
 * G. Welch, G. Bishop, "An introduction to the Kalman filter", 2006; Y. Bar-Shalom et al., "Estimation with applications to tracking
 * and navigation", 2001, section 11.6 (filters beside each other).
 */
#include "slip.h"

#include <math.h>
#include <string.h>

#include "../arithmetic/elementary.h"
#include "../arithmetic/matrix.h"

enum { N = FMFTS_SLIP_STATES, FILTERS = FMFTS_SLIP_FILTERS, MOVED = FMFTS_MOVED, STUCK = FMFTS_STUCK };
enum { FORCE = 2, SHEAR = 3, LEVER = 5, VELOCITY = 5, OFFSET = 7 };

/* By filter; SPEED mm/s. */
static const double SPEED[FILTERS] = {0.0, 8.0, 80.0}, LASTS_S[FILTERS] = {1.0, 0.15, 0.1};
/* Deviations of a change in a second: of a sticking place, which creeps, of the offset on a robot that turns, and of force and
 * shear, which a hand changes. With more for the place, STUCK follows a slow slip. */
#define PLACE_WALK_MM 0.01
#define OFFSET_WALK_MM_N 0.01
#define FORCE_WALK_N 10.0
#define SHEAR_WALK_N 3.0
#define HELD_MM 1e-3
#define FIRST_PLACE_MM 1.0
#define FIRST_FORCE_N 0.5
/* The lever of balls of 3 to 20 mm, solved by CalculiX with friction: lab/results/slip.md. */
#define LEVER_MM 0.25
#define LEVER_SD_MM 0.25
#define OFFSET_SD_MM_N 0.1
#define LEAST_FORCE_N 0.05 /* of the linearisation */
/* The memory of the score. */
#define REMEMBERS_S 0.1
/* χ² of five numbers that is exceeded once in ten million frames, as when a fast slip begins: the moving filters then restart; if
 * that happens again within CALM frames, all do. A finger that is gone surprises, too: nothing is reported before the UNSURE-th frame. */
#define SURPRISE_CHI2 43.0
#define CALM 12.0
#define SETTLED 8.0 /* as in friction.c */
#define UNSURE 2.0

typedef struct {
    double x[N], p[N][N], log_likelihood, chi2;
} filter;

void fmfts_forget_slip(fmfts_slip_memory *memory)
{
    memory->slip_frames = memory->slipping = memory->learnt_weight = memory->learnt_friction = 0.0;
    memory->first_weight = memory->first_s = 0.0;
}

/* Filters from the first one on. */
static void begin(int first, const fmfts_estimate *estimate, fmfts_slip_memory *memory)
{
    memset(memory->slip_score, 0, sizeof memory->slip_score);
    for (int f = first; f < FILTERS; f++) {
        double *x = memory->slip_state + N * f, *p = memory->slip_covariance + N * N * f;
        memset(x, 0, sizeof(double[N]));
        memset(p, 0, sizeof(double[N * N]));
        for (int i = 0; i < N; i++) {
            double spread = i < FORCE ? FIRST_PLACE_MM : i < VELOCITY ? FIRST_FORCE_N : i < OFFSET ? SPEED[f] : 0.0;
            x[i] = i < VELOCITY ? estimate->place[i] * (i < FORCE ? 1e3 : 1.0) : 0.0;
            p[(N + 1) * i] = spread * spread;
        }
    }
    if (first != STUCK) {
        return;
    }
    memory->slipping = memory->slip_since_s = 0.0;
    memory->slip_state[LEVER] = LEVER_MM;
    memory->slip_covariance[(N + 1) * LEVER] = LEVER_SD_MM * LEVER_SD_MM;
    memory->slip_covariance[(N + 1) * OFFSET] = memory->slip_covariance[(N + 1) * (OFFSET + 1)] = OFFSET_SD_MM_N * OFFSET_SD_MM_N;
}

static void predict(int which, double elapsed_s, filter *f)
{
    double fades = fmfts_exp(-elapsed_s / LASTS_S[which]), gained = (1.0 - fades * fades) * SPEED[which] * SPEED[which];
    for (int i = 0; which != STUCK && i < FORCE; i++) {
        f->x[i] += elapsed_s * f->x[VELOCITY + i];
        f->x[VELOCITY + i] *= fades;
        for (int k = 0; k < N; k++) { /* rows, then columns */
            f->p[i][k] += elapsed_s * f->p[VELOCITY + i][k];
            f->p[VELOCITY + i][k] *= fades;
        }
        for (int k = 0; k < N; k++) {
            f->p[k][i] += elapsed_s * f->p[k][VELOCITY + i];
            f->p[k][VELOCITY + i] *= fades;
        }
        f->p[VELOCITY + i][VELOCITY + i] += gained;
    }
    for (int i = 0; i < VELOCITY; i++) {
        double walk = i < FORCE ? PLACE_WALK_MM : i == FORCE ? FORCE_WALK_N : SHEAR_WALK_N;
        f->p[i][i] += walk * walk * elapsed_s;
    }
    for (int i = OFFSET; which == STUCK && i < N; i++) {
        f->p[i][i] += OFFSET_WALK_MM_N * OFFSET_WALK_MM_N * elapsed_s;
    }
}

/* The press by a filter's state, and the derivative of its place by the state. */
static void press_of(int which, const double *x, double press[FMFTS_MAX_PRESS], double by_state[2][N])
{
    memcpy(press, x, sizeof(double[FMFTS_MAX_PRESS]));
    memset(by_state, 0, sizeof(double[2][N]));
    double force = press[FORCE] = fmax(x[FORCE], LEAST_FORCE_N);
    for (int i = 0; i < FORCE; i++) {
        by_state[i][i] = 1.0;
        if (which == STUCK) {
            double away = (x[LEVER] * x[SHEAR + i] + x[OFFSET + i]) / force;
            press[i] += away;
            by_state[i][FORCE] = -away / force;
            by_state[i][SHEAR + i] = x[LEVER] / force;
            by_state[i][LEVER] = x[SHEAR + i] / force;
            by_state[i][OFFSET + i] = 1.0 / force;
        }
    }
}

/* One scalar measurement of deviation 1. */
static void take(const double h[N], double innovation, filter *f)
{
    double ph[N], s = 1.0;
    for (int i = 0; i < N; i++) {
        ph[i] = 0.0;
        for (int k = 0; k < N; k++) {
            ph[i] += f->p[i][k] * h[k];
        }
        s += h[i] * ph[i];
    }
    for (int i = 0; i < N; i++) {
        f->x[i] += ph[i] * innovation / s;
        for (int k = 0; k < N; k++) {
            f->p[i][k] -= ph[i] * ph[k] / s;
        }
    }
    f->chi2 += innovation * innovation / s;
    f->log_likelihood -= 0.5 * (innovation * innovation / s + fmfts_log(s));
}

/* factor [MOVED][MOVED]: L. */
static void update(int which, const fmfts_response *response, const fmfts_slip_frame *frame, const double *factor, filter *f)
{
    double press[FMFTS_MAX_PRESS], by_state[2][N], modelled[MOVED], slope[MOVED][FMFTS_MAX_PRESS], row[MOVED][N + 1], before[N];
    press_of(which, f->x, press, by_state);
    fmfts_respond(response, press, modelled, slope);
    memcpy(before, f->x, sizeof before);
    memset(row, 0, sizeof row);
    for (int i = 0; i < MOVED; i++) {
        memcpy(row[i] + FORCE, slope[i] + FORCE, sizeof(double[FMFTS_MAX_PRESS - FORCE]));
        for (int k = 0; k < N; k++) {
            row[i][k] += slope[i][0] * by_state[0][k] + slope[i][1] * by_state[1][k];
        }
        row[i][N] = frame->change[i] - modelled[i];
    }
    fmfts_solve_lower(MOVED, N + 1, factor, row[0]);
    for (int i = 0; i < MOVED; i++) {
        double innovation = row[i][N];
        for (int k = 0; k < N; k++) {
            innovation -= row[i][k] * (f->x[k] - before[k]); /* subtracts the update by earlier rows */
        }
        take(row[i], innovation, f);
    }
}

static bool is_on_table(const fmfts_response *response, const double *x)
{
    for (int i = 0; i < FORCE; i++) {
        if (!(x[i] >= response->first_mm[i] && x[i] <= fmfts_last_mm(response, i))) {
            return false;
        }
    }
    return true;
}

void fmfts_follow_slip(const fmfts_response *response, const fmfts_slip_frame *frame, const fmfts_estimate *estimate,
                       fmfts_slip_memory *memory)
{
    double factor[MOVED * MOVED], kept = fmfts_exp(-frame->elapsed_s / REMEMBERS_S), least_chi2 = INFINITY;
    memcpy(factor, frame->noise, sizeof factor);
    if (!fmfts_cholesky(MOVED, factor)) {
        fmfts_forget_slip(memory);
        return;
    }
    if (memory->slip_frames == 0.0) {
        begin(STUCK, estimate, memory);
    }
    memory->slip_frames += 1.0;
    memory->slip_since_s += frame->elapsed_s;
    double stuck[N], spread[N * N];
    memcpy(stuck, memory->slip_state, sizeof stuck);
    memcpy(spread, memory->slip_covariance, sizeof spread);
    for (int which = 0; which < FILTERS; which++) {
        filter f = {.log_likelihood = 0.0};
        double *x = memory->slip_state + N * which, *p = memory->slip_covariance + N * N * which;
        memcpy(f.x, x, sizeof f.x);
        memcpy(f.p, p, sizeof f.p);
        predict(which, frame->elapsed_s, &f);
        update(which, response, frame, factor, &f);
        memcpy(x, f.x, sizeof f.x);
        memcpy(p, f.p, sizeof f.p);
        memory->slip_score[which] = kept * memory->slip_score[which] + f.log_likelihood;
        least_chi2 = fmin(least_chi2, f.chi2);
        if (!is_on_table(response, x)) {
            least_chi2 = INFINITY;
            break;
        }
    }
    if (least_chi2 < SURPRISE_CHI2) {
        return;
    }
    if (least_chi2 < INFINITY && memory->slip_frames > SETTLED + CALM) {
        memcpy(memory->slip_state, stuck, sizeof stuck);
        memcpy(memory->slip_covariance, spread, sizeof spread);
        begin(STUCK + 1, estimate, memory);
        memory->slip_frames = SETTLED - UNSURE;
    } else {
        memory->slip_frames = memory->slipping = 0.0; /* the learnt friction stays */
    }
}

void fmfts_stuck_place(const fmfts_slip_memory *memory, double place[2], double covariance[2][2])
{
    const double *x = memory->slip_state, *p = memory->slip_covariance;
    double press[FMFTS_MAX_PRESS], by_state[2][N];
    press_of(STUCK, x, press, by_state);
    for (int i = 0; i < 2; i++) {
        place[i] = press[i];
    }
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 2; k++) {
            covariance[i][k] = 0.0;
            for (int a = 0; a < N; a++) {
                for (int b = 0; b < N; b++) {
                    covariance[i][k] += by_state[i][a] * p[N * a + b] * by_state[k][b];
                }
            }
        }
    }
}

void fmfts_stick_here(int which, bool held, fmfts_slip_memory *memory)
{
    const double *from = memory->slip_state + N * which, *spread = memory->slip_covariance + N * N * which;
    double *x = memory->slip_state, *p = memory->slip_covariance, before[N];
    double force = fmax(from[FORCE], LEAST_FORCE_N);
    for (int i = 0; i < N; i++) {
        before[i] = p[(N + 1) * i];
    }
    memset(p, 0, sizeof(double[N * N]));
    for (int i = 0; i < VELOCITY; i++) {
        x[i] = from[i] - (i < FORCE ? (x[LEVER] * from[SHEAR + i] + x[OFFSET + i]) / force : 0.0);
        for (int k = 0; k < VELOCITY; k++) {
            bool fixed = held && (i < FORCE || k < FORCE);
            p[N * i + k] = fixed ? (i == k ? HELD_MM * HELD_MM : 0.0) : spread[N * i + k];
        }
    }
    for (int i = LEVER; i < N; i++) {
        p[(N + 1) * i] = before[i];
    }
    memory->slip_spread = 0.5 * (spread[0] + spread[N + 1]);
    memory->slip_since_s = 0.0;
}
