/* Whether the finger slips, from the filters of slip.c, and its friction from its slips.
 *
 * While the finger sticks, the places of STUCK and of a moving filter differ by noise alone. The evidence that it moves is
 *
 *     E = dᵀ(P + P')⁻¹d / 2,  d: difference of the places, P, P': their covariances;  ln odds = E + ln FALSE_ODDS
 *
 * A finger that rolls moves its place, too. Only a slipping finger shears the silicone along its motion, with its
 * friction µ:
 *
 *     slips = moves · Φ((t − µ_least·force)/σ_t),  t: shear along d
 *
 * The baseline's error of the shear, of variance L², is the same in all frames. A finger that has just come pulls little, so
 * the shear of its first moments is mostly this error: with the variance F² of that little pull and of the noise, the share
 * L²/(L² + F²) of it is subtracted, and L²·F²/(L² + F²) is left. A finger that has rolled away by |d| has another error there.
 *
 * Once it slips, STUCK is put where the finger is, again and again: a finger of speed v would be ahead of it by D = v·dt, one that has
 * stopped by 0. With d along the motion and its variance s², the log odds of going on grow by (d·D − D²/2)/s² (A. Wald, "Sequential
 * analysis", 1947). While it slips, |shear|/force is its friction, even outside slip_friction. The smallest
 * slip_friction only separates slips from rolling. Above the largest, a ball digs in, or the setting is wrong: the
 * margin uses the largest, and the deviation covers both. */
#include <math.h>

#include "../arithmetic/erfc.h"
#include "slip.h"

enum { N = FMFTS_SLIP_STATES, FILTERS = FMFTS_SLIP_FILTERS, STUCK = FMFTS_STUCK, FORCE = 2, SHEAR = 3, VELOCITY = 5 };

/* Odds that a frame of a finger that sticks is the first of a slip: at most one false alarm a minute (lab/results/slip.md). */
#define FALSE_ODDS 2e-4
#define BEGINS 0.9
#define ENDS 0.2
#define GOES_ON 3.0       /* log odds with which it goes on */
#define CONFIRMED 0.99752737684336534 /* probability, 1/(1 + e⁻⁶), at which STUCK is put where the finger is */
/* Share of its speed with which the finger should continue: with too large a velocity, a moving finger looks as if it
 * stopped. */
#define SLOWER 0.6
#define LEAST_SPEED_MM_PER_S 3.0
#define M_PER_MM 1e-3
/* Nothing is reported below this force, above this deviation of the place, and in the first frames. */
#define LEAST_FORCE_N 0.2
#define PLACED_MM 0.4
#define SETTLED_FRAMES 8.0
/* Frames of a slip are not independent measurements of the shear: the filters' memory in frames. */
#define REMEMBERS_S 0.03
#define LARGEST_ANGLE_SD 1.8137993642342178 /* deviation of an unknown direction: pi/sqrt(3) */
/* First moments of a touch, and the deviation of the pull in them, over the force. */
#define FIRST_S 0.2
#define FIRST_PULL_SHARE 0.05
/* Where the baseline's error of the shear is another one, and how much larger it may get. */
#define ELSEWHERE_MM 1.0
#define OTHER_ERROR 2.0
/* A slip does not change the force by so much. At the rim, a larger force and shear farther out explain a light press, too. */
#define OTHER_FORCE 1.7
/* The finger's shape differs from the probe's: share of the shear, one deviation (lab/results/slip.md). */
#define SHAPE_SHARE 0.2

/* A shear without its most likely lasting error; the variance of what is left of that error, and of all of it. */
typedef struct {
    double n[2], left, lasting;
} pull;

/* The finger's motion by the filters. which: the moving filter that explains it best. */
typedef struct {
    int which;
    double away[2], spread[2][2], evidence;
} motion;

static double square(double x)
{
    return x * x;
}

static double length(const double *vector)
{
    return sqrt(square(vector[0]) + square(vector[1]));
}

/* atan y for 0 <= y <= 1: y is replaced three times by the tangent of half its angle; then its series. */
static double arctangent(double y)
{
    double sum = 0.0;
    for (int half = 0; half < 3; half++) {
        y /= 1.0 + sqrt(1.0 + y * y);
    }
    for (int odd = 25; odd > 0; odd -= 2) { /* y < 0.1: the next term is below 1e-27 */
        sum = 1.0 / odd - y * y * sum;
    }
    return 8.0 * y * sum;
}

/* The angle of a vector, −π to π, with the same bits on every processor. */
static double angle_of(const double *vector)
{
    const double pi = 3.14159265358979323846;
    double x = fabs(vector[0]), y = fabs(vector[1]);
    double angle = x >= y ? arctangent(x > 0.0 ? y / x : 0.0) : 0.5 * pi - arctangent(x / y);
    angle = vector[0] < 0.0 ? pi - angle : angle;
    return vector[1] < 0.0 ? -angle : angle;
}

/* The probability that a normal variable is above −deviations. */
static double above(double deviations)
{
    double tail = 0.5 * fmfts_erfc(fabs(deviations) * 0.70710678118654752);
    return deviations > 0.0 ? 1.0 - tail : tail;
}


static motion find_motion(const fmfts_slip_memory *memory)
{
    double place[2], covariance[2][2];
    motion found = {.which = STUCK + 1};
    fmfts_stuck_place(memory, place, covariance);
    for (int f = STUCK + 1; f < FILTERS; f++) {
        found.which = memory->slip_score[f] > memory->slip_score[found.which] ? f : found.which;
    }
    const double *x = memory->slip_state + N * found.which, *p = memory->slip_covariance + N * N * found.which;
    for (int i = 0; i < 2; i++) {
        found.away[i] = x[i] - place[i];
        for (int k = 0; k < 2; k++) {
            found.spread[i][k] = covariance[i][k] + p[N * i + k];
        }
    }
    double(*s)[2] = found.spread, *d = found.away, determinant = s[0][0] * s[1][1] - s[0][1] * s[1][0];
    double weighted = s[1][1] * d[0] * d[0] - 2.0 * s[0][1] * d[0] * d[1] + s[0][0] * d[1] * d[1];
    found.evidence = determinant > 0.0 ? 0.5 * weighted / determinant : 0.0;
    return found;
}

static double probability(double log_odds)
{
    return 1.0 / (1.0 + fmfts_exp(-log_odds));
}

/* Log odds that a slip continues, from the finger's distance ahead of STUCK. */
static double going_on(const fmfts_slip_memory *memory, const motion *found)
{
    const double *v = memory->slip_state + N * found->which + VELOCITY;
    double speed = length(v), ahead = memory->slip_speed * memory->slip_since_s, along = 0.0, variance = memory->slip_spread;
    if (!(speed > 0.0)) {
        return GOES_ON;
    }
    for (int i = 0; i < 2; i++) {
        along += found->away[i] * v[i] / speed;
        for (int k = 0; k < 2; k++) {
            variance += v[i] * found->spread[i][k] * v[k] / (speed * speed);
        }
    }
    return GOES_ON + (along * ahead - 0.5 * ahead * ahead) / variance;
}

static void learn(double elapsed_s, double force, const double *shear, double variance, fmfts_slip_memory *memory)
{
    double squared = square(shear[0]) + square(shear[1]) - 2.0 * variance;
    double ratio = sqrt(fmax(squared, 0.0)) / force, share = fmin(elapsed_s / REMEMBERS_S, 1.0);
    double weight = share * square(force) / variance;
    if (!(weight > 0.0)) { /* no time has passed */
        return;
    }
    memory->learnt_friction += (ratio - memory->learnt_friction) * weight / (memory->learnt_weight + weight);
    memory->learnt_weight += weight;
}

/* The mean shear of the first moments of a touch. */
static void take_first_shear(double elapsed_s, fmfts_slip_memory *memory)
{
    const double *x = memory->slip_state, *p = memory->slip_covariance;
    double variance = 0.5 * (p[(N + 1) * SHEAR] + p[(N + 1) * (SHEAR + 1)]);
    double weight = fmin(elapsed_s / REMEMBERS_S, 1.0) / variance;
    if (memory->first_s >= FIRST_S || !(weight > 0.0)) {
        return;
    }
    memory->first_weight += weight;
    memory->first_s += elapsed_s;
    for (int i = 0; i < 2; i++) {
        memory->first_shear[i] = memory->first_weight == weight ? 0.0 : memory->first_shear[i];
        memory->first_shear[i] += (x[SHEAR + i] - memory->first_shear[i]) * weight / memory->first_weight;
    }
}

static pull pull_of(double lasting_sd_n, const double *x, const fmfts_slip_memory *memory)
{
    pull found = {.lasting = square(lasting_sd_n)};
    double share = 0.0;
    if (memory->first_weight > 0.0) {
        share = found.lasting / (found.lasting + square(FIRST_PULL_SHARE * x[FORCE]) + 1.0 / memory->first_weight);
    }
    for (int i = 0; i < 2; i++) {
        found.n[i] = x[SHEAR + i] - share * memory->first_shear[i];
    }
    found.left = (1.0 - share) * found.lasting;
    return found;
}

/* The probability that it slips; updates whether it does. */
static double follow(const fmfts_slip_parameters *parameters, const pull *shear, const motion *found, fmfts_slip_memory *memory)
{
    const double *x = memory->slip_state + N * found->which, *p = memory->slip_covariance + N * N * found->which;
    bool was_slipping = memory->slipping != 0.0;
    double moves = probability(was_slipping ? going_on(memory, found) : found->evidence + fmfts_log(FALSE_ODDS));
    const double *way = was_slipping ? x + VELOCITY : found->away;
    double along = (shear->n[0] * way[0] + shear->n[1] * way[1]) / fmax(length(way), 1e-9);
    double other = shear->lasting * square(fmin(length(found->away) / ELSEWHERE_MM, OTHER_ERROR));
    double variance = 0.5 * (p[(N + 1) * SHEAR] + p[(N + 1) * (SHEAR + 1)]) + shear->left + other;
    double slips = moves * above((along - parameters->slip_friction[0] * x[FORCE]) / sqrt(variance));
    double force = memory->slip_state[FORCE]; /* by STUCK */
    if (!was_slipping && fmax(force, x[FORCE]) > OTHER_FORCE * fmin(force, x[FORCE])) {
        slips = fmin(slips, 1.0 - BEGINS);
    }
    memory->slipping = slips > (was_slipping ? ENDS : BEGINS);
    bool begins = memory->slipping != 0.0 && !was_slipping, goes_on = was_slipping && moves > CONFIRMED;
    if (begins || goes_on || (was_slipping && memory->slipping == 0.0)) {
        memory->slip_speed = fmax(SLOWER * length(x + VELOCITY), LEAST_SPEED_MM_PER_S);
        fmfts_stick_here(found->which, memory->slipping != 0.0, memory);
    }
    return slips;
}

void fmfts_judge_slip(const fmfts_slip_parameters *parameters, const fmfts_slip_frame *frame, fmfts_slip_memory *memory,
                      fmfts_slip *slip)
{
    motion found = find_motion(memory);
    const double *x = memory->slip_state + N * found.which, *p = memory->slip_covariance + N * N * found.which;
    double force = x[FORCE];
    slip->known = memory->slip_frames >= SETTLED_FRAMES && force > LEAST_FORCE_N &&
                  memory->slip_state[FORCE] > LEAST_FORCE_N &&
                  fmax(memory->slip_covariance[0], memory->slip_covariance[N + 1]) < square(PLACED_MM);
    if (!slip->known) {
        memory->slipping = 0.0;
        if (!(memory->slip_state[FORCE] > LEAST_FORCE_N)) {
            memory->slip_frames = 0.0; /* filters that began with a lighter press may have the wrong place */
        }
        return;
    }
    take_first_shear(frame->elapsed_s, memory);
    pull shear = pull_of(frame->shear_sd_n, x, memory);
    double shear_variance = 0.5 * (p[(N + 1) * SHEAR] + p[(N + 1) * (SHEAR + 1)]), speed = length(x + VELOCITY);
    double speed_sd = sqrt(0.5 * (p[(N + 1) * VELOCITY] + p[(N + 1) * (VELOCITY + 1)]));
    slip->sticking = 1.0 - follow(parameters, &shear, &found, memory);
    slip->slipping = memory->slipping != 0.0;
    if (slip->slipping) {
        learn(frame->elapsed_s, force, shear.n, shear_variance, memory);
    }
    slip->speed_m_per_s = speed * M_PER_MM;
    slip->speed_sd_m_per_s = speed_sd * M_PER_MM;
    slip->direction_rad = angle_of(x + VELOCITY);
    slip->direction_sd_rad = fmin(speed_sd / fmax(speed, 1e-9), LARGEST_ANGLE_SD);
    slip->knows_friction = memory->learnt_weight > 0.0;
    if (slip->knows_friction) {
        double variance = 1.0 / memory->learnt_weight + shear.left / square(force) + square(SHAPE_SHARE * memory->learnt_friction);
        slip->friction = fmin(memory->learnt_friction, parameters->slip_friction[1]);
        variance += square(memory->learnt_friction - slip->friction);
        slip->friction_sd = sqrt(variance);
        slip->margin_n = slip->friction * force - length(shear.n);
        slip->margin_sd_n = sqrt(variance * square(force) + shear_variance);
    }
}
