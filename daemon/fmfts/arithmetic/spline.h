/* What tables of presses are made of: cubic B-splines on evenly spaced knots, and powers of a load. */
#ifndef FMFTS_SPLINE_H
#define FMFTS_SPLINE_H

#include <stddef.h>
#include <string.h>

#include "wide.h"

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

enum { FMFTS_CELLS = FMFTS_COVERING * FMFTS_COVERING };

/* What a sum over the cells that cover a place is weighted with. */
enum { FMFTS_VALUE, FMFTS_BY_X, FMFTS_BY_Y, FMFTS_LAPLACIAN, FMFTS_KINDS };

/* The cells of a table that cover a place, and the weight of each in every kind of sum. */
typedef struct {
    const double *cell[FMFTS_CELLS];
    double weight[FMFTS_CELLS][FMFTS_KINDS];
} fmfts_patch;

/* table: `width` cells along y, of `numbers` each. */
static inline void fmfts_cover_place(const double *table, size_t width, size_t numbers, const fmfts_splines *x, const fmfts_splines *y,
                                     fmfts_patch *patch)
{
    for (size_t k = 0; k < FMFTS_CELLS; k++) {
        size_t i = k / FMFTS_COVERING, j = k % FMFTS_COVERING;
        patch->cell[k] = table + ((x->cell + i) * width + y->cell + j) * numbers;
        patch->weight[k][FMFTS_VALUE] = x->value[i] * y->value[j];
        patch->weight[k][FMFTS_BY_X] = x->slope[i] * y->value[j];
        patch->weight[k][FMFTS_BY_Y] = x->value[i] * y->slope[j];
        patch->weight[k][FMFTS_LAPLACIAN] = x->value[i] * y->second[j] + x->second[i] * y->value[j];
    }
}

/* sum[kind · stride + i] = Σ_c weight[c][kind] · cell[c][i], of all numbers from `first` to `end`. The sums stay in registers if the
 * compiler unrolls the kinds, which it does not do by itself. */
static inline void fmfts_add_up(const fmfts_patch *patch, int kinds, size_t first, size_t end, double *sum, size_t stride)
{
    for (; first + FMFTS_LANES <= end; first += FMFTS_LANES) {
        fmfts_four own[FMFTS_KINDS] = {{0.0}}, four;
        for (size_t k = 0; k < FMFTS_CELLS; k++) {
            memcpy(&four, patch->cell[k] + first, sizeof four);
#pragma GCC unroll 4
            for (int kind = 0; kind < kinds; kind++) {
                own[kind] += patch->weight[k][kind] * four;
            }
        }
#pragma GCC unroll 4
        for (int kind = 0; kind < kinds; kind++) {
            memcpy(sum + (size_t)kind * stride + first, &own[kind], sizeof own[kind]);
        }
    }
    for (; first < end; first++) {
        for (int kind = 0; kind < kinds; kind++) {
            double own = 0.0;
            for (size_t k = 0; k < FMFTS_CELLS; k++) {
                own += patch->weight[k][kind] * patch->cell[k][first];
            }
            sum[(size_t)kind * stride + first] = own;
        }
    }
}

#endif
