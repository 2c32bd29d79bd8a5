#include "press_table.h"

#include <string.h>

#include "../arithmetic/spline.h"
#include "../arithmetic/wide.h"

enum { VALUE, BY_X, BY_Y, LAPLACIAN, KINDS };
enum { CELLS = FMFTS_COVERING * FMFTS_COVERING, NUMBERS = (FMFTS_TABLE_TERMS + 2) * FMFTS_MOST_CHANGE };

/* The cells of the table that cover a place, and the weight of each in every kind of sum. */
typedef struct {
    const double *cell[CELLS];
    double weight[CELLS][KINDS];
} cover;

/* sum[kind][i] = Σ_c weight[c][kind] · cell[c][i], of all numbers from `first` to `end`. */
static inline void add_up(const cover *c, int kinds, size_t first, size_t end, double sum[KINDS][NUMBERS])
{
    for (; first + FMFTS_LANES <= end; first += FMFTS_LANES) {
        fmfts_four own[KINDS] = {{0.0}}, four;
        for (size_t k = 0; k < CELLS; k++) {
            memcpy(&four, c->cell[k] + first, sizeof four);
            for (int kind = 0; kind < kinds; kind++) {
                own[kind] += c->weight[k][kind] * four;
            }
        }
        for (int kind = 0; kind < kinds; kind++) {
            memcpy(sum[kind] + first, &own[kind], sizeof own[kind]);
        }
    }
    for (; first < end; first++) {
        for (int kind = 0; kind < kinds; kind++) {
            sum[kind][first] = 0.0;
            for (size_t k = 0; k < CELLS; k++) {
                sum[kind][first] += c->weight[k][kind] * c->cell[k][first];
            }
        }
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

FMFTS_WIDE void fmfts_press_by_table(const fmfts_press_table *table, const double finger[FMFTS_FINGER], bool with_shear, double *pressed)
{
    const fmfts_knots knots = {table->first_mm, table->spacing_mm, table->width - 3};
    double value[FMFTS_TABLE_TERMS], slope[FMFTS_TABLE_TERMS];
    double sum[KINDS][NUMBERS];
    size_t poses = table->poses, of_force = table->terms * poses, all = of_force + 2 * poses;
    fmfts_splines x, y;
    cover c;
    fmfts_cover(&knots, finger[0], &x);
    fmfts_cover(&knots, finger[1], &y);
    fmfts_powers(finger[2], table->scale_n, table->terms, value, slope);
    for (size_t k = 0; k < CELLS; k++) {
        size_t i = k / FMFTS_COVERING, j = k % FMFTS_COVERING;
        c.cell[k] = table->table + ((x.cell + i) * table->width + y.cell + j) * all;
        c.weight[k][VALUE] = x.value[i] * y.value[j];
        c.weight[k][BY_X] = x.slope[i] * y.value[j];
        c.weight[k][BY_Y] = x.value[i] * y.slope[j];
        c.weight[k][LAPLACIAN] = x.value[i] * y.second[j] + x.second[i] * y.value[j];
    }
    if (with_shear) {
        add_up(&c, KINDS, 0, of_force, sum);
        add_up(&c, VALUE + 1, of_force, all, sum);
    } else {
        add_up(&c, LAPLACIAN, 0, of_force, sum);
    }
    double *by_finger = pressed + poses, *by_shear = by_finger + 3 * poses;
    weighted(table, value, sum[VALUE], 1, pressed);
    weighted(table, value, sum[BY_X], 3, by_finger);
    weighted(table, value, sum[BY_Y], 3, by_finger + 1);
    weighted(table, slope, sum[VALUE], 3, by_finger + 2);
    for (size_t i = 0; with_shear && i < poses; i++) {
        by_shear[2 * i] = sum[VALUE][of_force + i];
        by_shear[2 * i + 1] = sum[VALUE][of_force + poses + i];
    }
    if (with_shear) {
        weighted(table, value, sum[LAPLACIAN], 1, by_shear + 2 * poses);
    }
}
