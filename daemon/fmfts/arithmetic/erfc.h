/* erfc with the same bits on every processor: only +, -, * and /, as in elementary.h. Sums of two doubles have 31
 * digits, so that the result is the correctly rounded value, except for one argument in a billion; it equals that of
 * series.py. */
#ifndef FMFTS_ERFC_H
#define FMFTS_ERFC_H

#include "elementary.h"

/* high + low, |low| at most half a unit in the last place of high. */
typedef struct {
    double high, low;
} fmfts_pair;

/* |a| >= |b|, or a is zero. */
static inline fmfts_pair fmfts_pair_of(double a, double b)
{
    double sum = a + b;
    return (fmfts_pair){sum, b - (sum - a)};
}

static inline fmfts_pair fmfts_pair_sum(fmfts_pair a, fmfts_pair b)
{
    double sum = a.high + b.high, of_b = sum - a.high;
    double error = (a.high - (sum - of_b)) + (b.high - of_b);
    return fmfts_pair_of(sum, error + (a.low + b.low));
}

static inline fmfts_pair fmfts_pair_product(fmfts_pair a, fmfts_pair b)
{
    double error, product = fmfts_two_product(a.high, b.high, &error);
    return fmfts_pair_of(product, error + (a.high * b.low + a.low * b.high));
}

static inline fmfts_pair fmfts_pair_quotient(fmfts_pair a, fmfts_pair b)
{
    double first = a.high / b.high;
    fmfts_pair taken = fmfts_pair_product((fmfts_pair){-first, 0.0}, b);
    return fmfts_pair_of(first, fmfts_pair_sum(a, taken).high / b.high);
}

/* exp(−x) · 2^halvings, between 0.7 and 1.5. */
static inline fmfts_pair fmfts_pair_decay(fmfts_pair x, int *halvings)
{
    *halvings = (int)(x.high / FMFTS_LN2_HIGH + 0.5);
    double count = *halvings, error, product = fmfts_two_product(count, FMFTS_LN2_LOW, &error);
    fmfts_pair rest = fmfts_pair_sum((fmfts_pair){count * FMFTS_LN2_HIGH, 0.0}, (fmfts_pair){-x.high, -x.low});
    rest = fmfts_pair_sum(rest, (fmfts_pair){product, error});
    fmfts_pair total = {1.0, 0.0};
    for (int k = 26; k > 0; k--) { /* 1 + r(1 + r/2(1 + r/3(…))), |r| < 0.35 */
        total = fmfts_pair_product(fmfts_pair_quotient(rest, (fmfts_pair){k, 0.0}), total);
        total = fmfts_pair_sum((fmfts_pair){1.0, 0.0}, total);
    }
    return total;
}

/* √π/2 · exp(x²) · erf(x) = Σ 2ⁿ x²ⁿ⁺¹/(1·3·…·(2n+1)): Abramowitz & Stegun 7.1.6. All terms have the same sign. */
static inline fmfts_pair fmfts_erf_series(double x, fmfts_pair square)
{
    fmfts_pair term = {x, 0.0}, total = term, twice = {2.0 * square.high, 2.0 * square.low};
    for (double odd = 3.0; term.high > 0x1p-110 * total.high; odd += 2.0) {
        term = fmfts_pair_quotient(fmfts_pair_product(term, twice), (fmfts_pair){odd, 0.0});
        total = fmfts_pair_sum(total, term);
    }
    return total;
}

/* x + ½/(x + 1/(x + ³⁄₂/(x + …))), the inverse of √π · exp(x²) · erfc(x): Abramowitz & Stegun 7.1.14. */
static inline fmfts_pair fmfts_erfc_fraction(double x)
{
    fmfts_pair own = {x, 0.0}, rest = own;
    for (int term = 120; term > 0; term--) {
        rest = fmfts_pair_sum(own, fmfts_pair_quotient((fmfts_pair){0.5 * term, 0.0}, rest));
    }
    return rest;
}

/* 1 − erf(x) for x >= 0, correct to its last bit also where it is small; NaN below zero. */
static inline double fmfts_erfc(double x)
{
    const double far = 2.0, underflow = 27.3;         /* as in series.py */
    const fmfts_pair inverse_root_of_pi = {0x1.20dd750429b6dp-1, 0x1.1ae3a914fed80p-57};
    double error, product = fmfts_two_product(x, x, &error);
    fmfts_pair square = {product, error};
    int halvings;
    if (!(x >= 0.0 && x <= underflow)) {
        return x > underflow ? 0.0 : NAN;
    }
    fmfts_pair decay = fmfts_pair_product(inverse_root_of_pi, fmfts_pair_decay(square, &halvings));
    if (x > far) {
        double part = fmfts_pair_quotient(decay, fmfts_erfc_fraction(x)).high;
        int half = halvings / 2; /* in two steps: 2^-halvings alone may be below a double's range */
        return part * fmfts_power_of_two(-half) * fmfts_power_of_two(half - halvings);
    }
    double scale = -2.0 * fmfts_power_of_two(-halvings);
    fmfts_pair minus_erf = fmfts_pair_product((fmfts_pair){scale * decay.high, scale * decay.low}, fmfts_erf_series(x, square));
    return fmfts_pair_sum((fmfts_pair){1.0, 0.0}, minus_erf).high;
}

#endif
