/* The tail of the χ² distribution in closed form, as in chi2.py. */
#ifndef FMFTS_CHI2_H
#define FMFTS_CHI2_H

#include <stdbool.h>

#include "../arithmetic/erfc.h"

#define FMFTS_PI 3.14159265358979323846

/* The probability that χ² exceeds `value`: Abramowitz & Stegun 26.4.4, 26.4.5, for whole degrees of freedom. */
static inline double fmfts_survival(double value, int degrees_of_freedom)
{
    double half = fmax(value, 0.0) / 2.0; /* rounding may make χ² of a perfect fit negative */
    bool is_odd = degrees_of_freedom % 2 != 0;
    double total = is_odd ? fmfts_erfc(sqrt(half)) : fmfts_exp(-half);
    double term = is_odd ? 2.0 * fmfts_exp(-half) * sqrt(half / FMFTS_PI) : total * half;
    for (int k = is_odd ? 3 : 4; k <= degrees_of_freedom; k += 2) {
        total += term;
        term *= value / k;
    }
    return total;
}

#endif
