#include "press_table.h"

#include <string.h>

#include "../arithmetic/spline.h"
#include "../arithmetic/wide.h"

enum { VALUE, BY_X, BY_Y, LAPLACIAN, KINDS };

/* sum [count] += weight · row [count] */
static void add(size_t count, double weight, const double *restrict row, double *restrict sum)
{
    for (size_t i = 0; i < count; i++) {
        sum[i] += weight * row[i];
    }
}

/* out[i · stride] = Σ_t weight[t] · terms[t][i], for each of the numbers of pose. */
static void weighted(const fmfts_press_table *table, const double *weight, const double *terms, size_t stride, double *out)
{
    for (size_t i = 0; i < table->poses; i++) {
        double sum = 0.0;
        for (size_t term = 0; term < table->terms; term++) {
            sum += weight[term] * terms[term * table->poses + i];
        }
        out[i * stride] = sum;
    }
}

FMFTS_WIDE void fmfts_press_by_table(const fmfts_press_table *table, const double finger[FMFTS_FINGER], double *pressed)
{
    const fmfts_knots knots = {table->first_mm, table->spacing_mm, table->width - 3};
    double value[FMFTS_TABLE_TERMS], slope[FMFTS_TABLE_TERMS];
    double sum[KINDS][(FMFTS_TABLE_TERMS + 2) * FMFTS_MOST_CHANGE];
    size_t poses = table->poses, of_force = table->terms * poses, all = of_force + 2 * poses;
    fmfts_splines x, y;
    fmfts_cover(&knots, finger[0], &x);
    fmfts_cover(&knots, finger[1], &y);
    fmfts_powers(finger[2], table->scale_n, table->terms, value, slope);
    for (int kind = 0; kind < KINDS; kind++) {
        memset(sum[kind], 0, all * sizeof(double));
    }
    for (size_t i = 0; i < FMFTS_COVERING; i++) {
        for (size_t j = 0; j < FMFTS_COVERING; j++) {
            const double *cell = table->table + ((x.cell + i) * table->width + y.cell + j) * all;
            add(all, x.value[i] * y.value[j], cell, sum[VALUE]);
            add(of_force, x.slope[i] * y.value[j], cell, sum[BY_X]);
            add(of_force, x.value[i] * y.slope[j], cell, sum[BY_Y]);
            add(of_force, x.value[i] * y.second[j] + x.second[i] * y.value[j], cell, sum[LAPLACIAN]);
        }
    }
    double *by_finger = pressed + poses, *by_shear = by_finger + 3 * poses;
    weighted(table, value, sum[VALUE], 1, pressed);
    weighted(table, value, sum[BY_X], 3, by_finger);
    weighted(table, value, sum[BY_Y], 3, by_finger + 1);
    weighted(table, slope, sum[VALUE], 3, by_finger + 2);
    for (size_t i = 0; i < poses; i++) {
        by_shear[2 * i] = sum[VALUE][of_force + i];
        by_shear[2 * i + 1] = sum[VALUE][of_force + poses + i];
    }
    weighted(table, value, sum[LAPLACIAN], 1, by_shear + 2 * poses);
}
