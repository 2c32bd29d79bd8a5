/* What tables of presses are made of: cubic B-splines on evenly spaced knots, and powers of a load. */
#ifndef FMFTS_SPLINE_H
#define FMFTS_SPLINE_H

#include <stddef.h>

enum { FMFTS_COVERING = 4 }; /* B-splines that cover a place, along one axis */

/* There are cells + 1 knots, and cells + 3 splines. */
typedef struct {
    double first, spacing;
    size_t cells;
} fmfts_knots;

/* The splines that cover a place: index of the first, and each one's value, derivative and second derivative. */
typedef struct {
    size_t cell;
    double value[FMFTS_COVERING], slope[FMFTS_COVERING], second[FMFTS_COVERING];
} fmfts_splines;

/* A place beyond the knots counts as on the last one. */
static inline void fmfts_cover(const fmfts_knots *knots, double at, fmfts_splines *splines)
{
    double place = (at - knots->first) / knots->spacing, cells = (double)knots->cells, h = knots->spacing;
    place = !(place >= 0.0) ? 0.0 : place > cells ? cells : place;
    size_t cell = place > cells - 1.0 ? knots->cells - 1 : (size_t)place;
    double u = place - (double)cell, v = 1.0 - u;
    splines->cell = cell;
    splines->value[0] = v * v * v / 6.0;
    splines->value[1] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0;
    splines->value[2] = (-3.0 * u * u * u + 3.0 * u * u + 3.0 * u + 1.0) / 6.0;
    splines->value[3] = u * u * u / 6.0;
    splines->slope[0] = -v * v / 2.0 / h;
    splines->slope[1] = (3.0 * u * u - 4.0 * u) / 2.0 / h;
    splines->slope[2] = (-3.0 * u * u + 2.0 * u + 1.0) / 2.0 / h;
    splines->slope[3] = u * u / 2.0 / h;
    splines->second[0] = v / (h * h);
    splines->second[1] = (3.0 * u - 2.0) / (h * h);
    splines->second[2] = (3.0 * v - 2.0) / (h * h);
    splines->second[3] = u / (h * h);
}

/* x, x² … of `count` powers, and their derivatives; above `most` they follow their tangents. */
static inline void fmfts_powers(double x, double most, size_t count, double *value, double *slope)
{
    double inside = most < x ? most : x, power = 1.0;
    for (size_t i = 0; i < count; i++) {
        slope[i] = (double)(i + 1) * power;
        power *= inside;
        value[i] = power + slope[i] * (x - inside);
    }
}

#endif
