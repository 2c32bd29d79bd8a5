/* How far away another press explains a change of pose about as well as the one found.
 *
 * A light press near the middle moves the magnet much like a firmer one near the rim. Where the pose is uncertain, χ² has a long
 * valley between them, or two minima. Along it the force grows faster than linearly, so that its slope at the answer
 * gives too small a deviation. So χ² is evaluated REACH deviations away, both ways along both axes of the place's
 * ellipse, each time with the most likely force for that place. A step that raises χ² by Δ is sqrt(Δ) deviations; if it
 * changes the answer by d, the answer's deviation along this axis is d / sqrt(Δ), the slope of a chord. If χ² is lower
 * there than at the answer, the search continues from there.
 *
 * This does not question whether something presses: contacts are decided by the slope at the answer. */
#include <math.h>
#include <string.h>

#include "../arithmetic/descent.h"
#include "refine.h"

enum { SIZE = 3, FORCE = 2, STEPS = 8, FORCE_STEPS = 3, LOOKS = 3 }; /* of presses without shear */

static const double REACH = 3.0;
/* If the table ends closer to the answer than this, that direction is skipped. */
static const double NEAREST_MM = 0.5;
/* The answer has at least one deviation. */
static const double LEAST_DELTA = 1.0;

typedef struct {
    const fmfts_response *response;
    const double *change, *covariance;
    double information[FMFTS_MOVED][FMFTS_MOVED];
} look;

typedef struct {
    double press[SIZE], spread[SIZE * SIZE], chi2;
} minimum;

/* sum = aᵀ Ω b */
static double weighted(const look *look, const double a[FMFTS_MOVED], const double b[FMFTS_MOVED])
{
    double sum = 0.0;
    for (int i = 0; i < FMFTS_MOVED; i++) {
        for (int k = 0; k < FMFTS_MOVED; k++) {
            sum += a[i] * look->information[i][k] * b[k];
        }
    }
    return sum;
}

/* χ² of the most likely force at the place of `press`, which it receives. variance: of that force. */
static double at_place(const look *look, double press[SIZE], double *variance)
{
    double chi2 = 0.0;
    for (int step = 0; step <= FORCE_STEPS; step++) {
        double left[FMFTS_MOVED], by_force[FMFTS_MOVED], slope[FMFTS_MOVED][FMFTS_MAX_PRESS];
        fmfts_respond(look->response, press, left, slope);
        for (int i = 0; i < FMFTS_MOVED; i++) {
            left[i] = look->change[i] - left[i];
            by_force[i] = slope[i][FORCE];
        }
        double information = weighted(look, by_force, by_force);
        chi2 = weighted(look, left, left);
        *variance = 1.0 / information;
        if (step < FORCE_STEPS && information > 0.0) {
            press[FORCE] = fmax(press[FORCE] + weighted(look, by_force, left) / information, 0.0);
        }
    }
    return chi2;
}

/* Half axes (mm) of the ellipse of one deviation of the place. */
static void axes_of(const double spread[SIZE * SIZE], double axis[2][2])
{
    double a = spread[0], b = spread[1], c = spread[SIZE + 1];
    double half = 0.5 * (a - c), root = sqrt(half * half + b * b), largest = 0.5 * (a + c) + root;
    double x = half >= 0.0 ? half + root : b, y = half >= 0.0 ? b : root - half, length = sqrt(x * x + y * y);
    double longer = sqrt(largest), shorter = sqrt(fmax(a + c - largest, 0.0));
    x = length > 0.0 ? x / length : 1.0;
    y = length > 0.0 ? y / length : 0.0;
    axis[0][0] = longer * x, axis[0][1] = longer * y;
    axis[1][0] = -shorter * y, axis[1][1] = shorter * x;
}

/* The press this many deviations along an axis, at most on the table's edge. False if the answer is on that edge. */
static bool go(const look *look, const minimum *from, const double axis[2], double deviations, double press[SIZE])
{
    const fmfts_response *table = look->response;
    double square = 0.0;
    memcpy(press, from->press, sizeof(double[SIZE]));
    for (int i = 0; i < 2; i++) {
        press[i] = fmfts_within(from->press[i] + deviations * axis[i], table->first_mm[i], fmfts_last_mm(table, i));
        square += (press[i] - from->press[i]) * (press[i] - from->press[i]);
    }
    return square > NEAREST_MM * NEAREST_MM;
}

static bool descend(const look *look, minimum *found)
{
    fmfts_press_search search = {.change = look->change, .covariance = look->covariance, .steps = STEPS};
    return fmfts_refine(look->response, &search, found->press, found->spread, &found->chi2);
}

/* Adds the variances of the chords to `variance`. Returns whether a press with a lower χ² was found: `found` is then
 * that press. */
static bool look_around(const look *look, minimum *found, double variance[SIZE])
{
    double axis[2][2], unused;
    axes_of(found->spread, axis);
    for (int which = 0; which < 2; which++) {
        double largest[SIZE] = {0.0};
        for (int side = -1; side <= 1; side += 2) {
            minimum other;
            if (!go(look, found, axis[which], side * REACH, other.press)) {
                continue;
            }
            double delta = at_place(look, other.press, &unused) - found->chi2;
            if (delta < 0.0 && descend(look, &other) && other.chi2 < found->chi2 && other.press[FORCE] > 0.0) {
                *found = other;
                return true;
            }
            for (int i = 0; i < SIZE; i++) {
                double away = other.press[i] - found->press[i];
                largest[i] = fmax(largest[i], away * away / fmax(delta, LEAST_DELTA));
            }
        }
        for (int i = 0; i < SIZE; i++) {
            variance[i] += largest[i];
        }
    }
    return false;
}

void fmfts_look_elsewhere(const fmfts_response *response, const double change[FMFTS_MOVED], const double *covariance,
                          double *press, double *spread, double *wider)
{
    look look = {.response = response, .change = change, .covariance = covariance};
    minimum found;
    memcpy(found.press, press, sizeof found.press);
    if (!fmfts_information(covariance, look.information) || !descend(&look, &found) || !(found.press[FORCE] > 0.0)) {
        return;
    }
    double variance[SIZE], here[SIZE], of_force;
    for (int looks = 0; looks < LOOKS; looks++) {
        memset(variance, 0, sizeof variance);
        if (!look_around(&look, &found, variance)) {
            break;
        }
    }
    memcpy(here, found.press, sizeof here);
    at_place(&look, here, &of_force);
    variance[FORCE] += of_force;
    memcpy(press, found.press, sizeof found.press);
    memcpy(spread, found.spread, sizeof found.spread);
    for (int i = 0; i < SIZE; i++) {
        wider[i] = fmax(variance[i] / spread[(SIZE + 1) * i], 1.0);
    }
}
