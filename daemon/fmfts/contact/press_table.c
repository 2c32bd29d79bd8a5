#include "press_table.h"

#include <string.h>

enum { VALUE, BY_X, BY_Y, LAPLACIAN, KINDS };
enum { COVERING = 4 }; /* cubic B-splines that cover a place, along one axis */

/* The cell of a place, and the B-splines that cover it: their values, slopes and second derivatives. */
static size_t stencil(const fmfts_press_table *table, double along_mm, double value[COVERING], double slope[COVERING],
                      double second[COVERING])
{
    double cells = (double)(table->width - 3), h = table->spacing_mm;
    double place = (along_mm - table->first_mm) / h;
    place = 0.0 > place ? 0.0 : place;
    place = cells < place ? cells : place;
    size_t cell = (size_t)place, last = table->width - 4;
    cell = last < cell ? last : cell;
    double u = place - (double)cell, v = 1.0 - u;
    value[0] = v * v * v / 6.0;
    value[1] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0;
    value[2] = (3.0 * v * v * v - 6.0 * v * v + 4.0) / 6.0;
    value[3] = u * u * u / 6.0;
    slope[0] = -v * v / 2.0 / h;
    slope[1] = (3.0 * u * u - 4.0 * u) / 2.0 / h;
    slope[2] = -(3.0 * v * v - 4.0 * v) / 2.0 / h;
    slope[3] = u * u / 2.0 / h;
    second[0] = v / (h * h);
    second[1] = (3.0 * u - 2.0) / (h * h);
    second[2] = (3.0 * v - 2.0) / (h * h);
    second[3] = u / (h * h);
    return cell;
}

/* F, F² …, and their derivatives; above scale_n they follow their tangents. */
static void powers(const fmfts_press_table *table, double force_n, double *value, double *slope)
{
    double scale_n = table->scale_n, inside = scale_n < force_n ? scale_n : force_n, power = 1.0;
    for (size_t term = 0; term < table->terms; term++) {
        slope[term] = (double)(term + 1) * power;
        power *= inside;
        value[term] = power + slope[term] * (force_n - inside);
    }
}

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

void fmfts_press_by_table(const fmfts_press_table *table, const double finger[FMFTS_FINGER], double *pressed)
{
    double x[3][COVERING], y[3][COVERING], value[FMFTS_TABLE_TERMS], slope[FMFTS_TABLE_TERMS];
    double sum[KINDS][(FMFTS_TABLE_TERMS + 2) * FMFTS_MOST_CHANGE];
    size_t poses = table->poses, of_force = table->terms * poses, all = of_force + 2 * poses;
    size_t column = stencil(table, finger[0], x[0], x[1], x[2]), row = stencil(table, finger[1], y[0], y[1], y[2]);
    powers(table, finger[2], value, slope);
    for (int kind = 0; kind < KINDS; kind++) {
        memset(sum[kind], 0, all * sizeof(double));
    }
    for (size_t i = 0; i < COVERING; i++) {
        for (size_t j = 0; j < COVERING; j++) {
            const double *cell = table->table + ((column + i) * table->width + row + j) * all;
            add(all, x[0][i] * y[0][j], cell, sum[VALUE]);
            add(of_force, x[1][i] * y[0][j], cell, sum[BY_X]);
            add(of_force, x[0][i] * y[1][j], cell, sum[BY_Y]);
            add(of_force, x[0][i] * y[2][j] + x[2][i] * y[0][j], cell, sum[LAPLACIAN]);
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
