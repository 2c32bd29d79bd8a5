/* What one finger does to all poses: array_response.py of contact/ explains it. */
#include <string.h>

#include "several.h"

enum { VALUE, BY_X, BY_Y, LAPLACIAN, KINDS };
enum { COVERING = 4 }; /* cubic B-splines that cover a place, along one axis */

/* The cell of a place, and the B-splines that cover it: their values, slopes and second derivatives. */
static size_t stencil(const fmfts_several *model, double along_mm, double value[COVERING], double slope[COVERING],
                      double second[COVERING])
{
    double cells = (double)(model->width - 3), h = model->head->spacing_mm;
    double place = (along_mm - model->head->first_mm) / h;
    place = 0.0 > place ? 0.0 : place;
    place = cells < place ? cells : place;
    size_t cell = (size_t)place, last = model->width - 4;
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
static void powers(const fmfts_several *model, double force_n, double *value, double *slope)
{
    double scale_n = model->head->scale_n, inside = scale_n < force_n ? scale_n : force_n, power = 1.0;
    for (size_t term = 0; term < model->terms; term++) {
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
static void weighted(const fmfts_several *model, const double *weight, const double *terms, size_t stride, double *out)
{
    for (size_t i = 0; i < model->poses; i++) {
        double sum = 0.0;
        for (size_t term = 0; term < model->terms; term++) {
            sum += weight[term] * terms[term * model->poses + i];
        }
        out[i * stride] = sum;
    }
}

void fmfts_press(const fmfts_several *model, const double finger[FMFTS_FINGER], double *pressed)
{
    double x[3][COVERING], y[3][COVERING], value[FMFTS_SEVERAL_TERMS], slope[FMFTS_SEVERAL_TERMS];
    double table[KINDS][(FMFTS_SEVERAL_TERMS + 2) * FMFTS_SEVERAL_POSES];
    size_t poses = model->poses, of_force = model->terms * poses, all = of_force + 2 * poses;
    size_t column = stencil(model, finger[0], x[0], x[1], x[2]), row = stencil(model, finger[1], y[0], y[1], y[2]);
    powers(model, finger[2], value, slope);
    for (int kind = 0; kind < KINDS; kind++) {
        memset(table[kind], 0, all * sizeof(double));
    }
    for (size_t i = 0; i < COVERING; i++) {
        for (size_t j = 0; j < COVERING; j++) {
            const double *cell = model->table + ((column + i) * model->width + row + j) * all;
            add(all, x[0][i] * y[0][j], cell, table[VALUE]);
            add(of_force, x[1][i] * y[0][j], cell, table[BY_X]);
            add(of_force, x[0][i] * y[1][j], cell, table[BY_Y]);
            add(of_force, x[0][i] * y[2][j] + x[2][i] * y[0][j], cell, table[LAPLACIAN]);
        }
    }
    double *by_finger = pressed + poses, *by_shear = by_finger + 3 * poses;
    weighted(model, value, table[VALUE], 1, pressed);
    weighted(model, value, table[BY_X], 3, by_finger);
    weighted(model, value, table[BY_Y], 3, by_finger + 1);
    weighted(model, slope, table[VALUE], 3, by_finger + 2);
    for (size_t i = 0; i < poses; i++) {
        by_shear[2 * i] = table[VALUE][of_force + i];
        by_shear[2 * i + 1] = table[VALUE][of_force + poses + i];
    }
    weighted(model, value, table[LAPLACIAN], 1, by_shear + 2 * poses);
}
