#include "press_table.h"

#include "../arithmetic/spline.h"

enum { NUMBERS = (FMFTS_TABLE_TERMS + 2) * FMFTS_MOST_CHANGE };

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

FMFTS_WIDE void fmfts_press_by_table(const fmfts_press_table *table, const double finger[FMFTS_FINGER], bool with_shear, double *pressed)
{
    const fmfts_knots knots = {table->first_mm, table->spacing_mm, table->width - 3};
    double value[FMFTS_TABLE_TERMS], slope[FMFTS_TABLE_TERMS];
    double sum[FMFTS_KINDS][NUMBERS];
    size_t poses = table->poses, of_force = table->terms * poses, all = of_force + 2 * poses;
    fmfts_splines x, y;
    fmfts_patch patch;
    fmfts_cover(&knots, finger[0], &x);
    fmfts_cover(&knots, finger[1], &y);
    fmfts_powers(finger[2], table->scale_n, table->terms, value, slope);
    fmfts_cover_place(table->table, table->width, all, &x, &y, &patch);
    if (with_shear) {
        fmfts_add_up(&patch, FMFTS_KINDS, 0, of_force, sum[0], NUMBERS);
        fmfts_add_up(&patch, FMFTS_VALUE + 1, of_force, all, sum[0], NUMBERS);
    } else {
        fmfts_add_up(&patch, FMFTS_LAPLACIAN, 0, of_force, sum[0], NUMBERS);
    }
    double *by_finger = pressed + poses, *by_shear = by_finger + 3 * poses;
    weighted(table, value, sum[FMFTS_VALUE], 1, pressed);
    weighted(table, value, sum[FMFTS_BY_X], 3, by_finger);
    weighted(table, value, sum[FMFTS_BY_Y], 3, by_finger + 1);
    weighted(table, slope, sum[FMFTS_VALUE], 3, by_finger + 2);
    for (size_t i = 0; with_shear && i < poses; i++) {
        by_shear[2 * i] = sum[FMFTS_VALUE][of_force + i];
        by_shear[2 * i + 1] = sum[FMFTS_VALUE][of_force + poses + i];
    }
    if (with_shear) {
        weighted(table, value, sum[FMFTS_LAPLACIAN], 1, by_shear + 2 * poses);
    }
}
