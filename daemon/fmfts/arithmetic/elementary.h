/* exp and log with the same bits on every processor: only +, -, * and /, which IEEE 754 rounds the same everywhere.

exp: P. T. P. Tang, "Table-driven implementation of the exponential function in IEEE floating-point arithmetic", ACM
TOMS 15 (1989) 144. Within 0.54 units in the last place.
log: x = 2^m z with z about one, and log z = 2 artanh s with s = (z - 1)/(z + 1) as a sum of two doubles. Within 0.54. */
#ifndef FMFTS_ELEMENTARY_H
#define FMFTS_ELEMENTARY_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "tables.h"

static inline double fmfts_power_of_two(int exponent)
{
    uint64_t bits = (uint64_t)(1023 + exponent) << 52;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline double fmfts_exp(double x)
{
    const double round = 0x1.8p52; /* adding and subtracting it rounds to a whole number */
    if (!(x <= 0x1.62e42fefa39efp9)) {
        return x > 0.0 ? INFINITY : x;
    }
    if (x < -745.2) {
        return 0.0;
    }
    double count = (x * (FMFTS_EXP_STEPS / (FMFTS_LN2_HIGH + FMFTS_LN2_LOW)) + round) - round;
    int whole = (int)count, step = whole & (FMFTS_EXP_STEPS - 1), exponent = (whole - step) / FMFTS_EXP_STEPS;
    double high = x - count * (FMFTS_LN2_HIGH / FMFTS_EXP_STEPS);
    double low = -count * (FMFTS_LN2_LOW / FMFTS_EXP_STEPS);
    double r = high + low;
    double tail = r * r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0)))));
    double power_high = FMFTS_POWERS_OF_TWO[step][0], power_low = FMFTS_POWERS_OF_TWO[step][1];
    double value = power_high + (power_low + (power_high + power_low) * (high + (low + tail)));
    /* In two steps, as 2^exponent alone may be beyond a double's range. */
    int half = (exponent - (exponent & 1)) / 2;
    return value * fmfts_power_of_two(half) * fmfts_power_of_two(exponent - half);
}

/* Returns the rounded product a·b; writes its rounding error (T. J. Dekker, "A floating-point technique for extending
the available precision", 1971). */
static inline double fmfts_two_product(double a, double b, double *error)
{
    const double split = 0x1p27 + 1.0;
    double a_high = split * a - (split * a - a), b_high = split * b - (split * b - b);
    double a_low = a - a_high, b_low = b - b_high, product = a * b;
    *error = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low;
    return product;
}

static inline double fmfts_log(double x)
{
    if (!(x > 0.0 && x < INFINITY)) {
        return isnan(x) || x > 0.0 ? x : x == 0.0 ? -INFINITY : NAN;
    }
    int m;
    double z = frexp(x, &m);
    if (z < 0x1.6a09e667f3bcdp-1) {
        z *= 2.0;
        m--;
    }
    double f = z - 1.0, u = 2.0 + f, s = f / u, error;
    double product = fmfts_two_product(s, u, &error);
    /* The rounding error of s: (f - s (2 + f)) / u, exact but for its last rounding. */
    double s_low = ((f - product) - error - s * (f - (u - 2.0))) / u;
    double w = s * s, series = 1.0 / 21.0 + w * (1.0 / 23.0);
    for (int odd = 19; odd >= 3; odd -= 2) {
        series = 1.0 / odd + w * series;
    }
    double tail = 2.0 * (s_low + s * w * series);
    /* |m ln 2| is larger than |2 s|, or zero. */
    double large = m * FMFTS_LN2_HIGH, small = 2.0 * s, total = large + small;
    double rest = m ? small - (total - large) : 0.0;
    return total + (rest + (m * FMFTS_LN2_LOW + tail));
}

#endif
