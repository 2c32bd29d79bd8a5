/* The shear of each finger, as far as the residual tells it.
 *
 * Of a considered cause of deviation one, whose effect on the field is g, the residual r tells g'C⁻¹r, with the variance
 * 1 − g'C⁻¹g + h'Σh; h = J'C⁻¹g, J and Σ the slope by the fingers and their covariance. */
#include "fit.h"

#include <math.h>
#include <string.h>

#include "../arithmetic/matrix.h"

/* Column `i` of the shears in work->factor, from covariance.c: of each finger along x, along y, and its patch. */
static const double *shear_column(const fmfts_several *model, const fmfts_several_work *work, size_t i)
{
    size_t first = 3 + 1 + model->causes;
    return work->factor + (first + 3 * (i / 2) + i % 2) * model->stride;
}

void fmfts_shear_of(const fmfts_several *model, fmfts_fingers fingers, const double *covariance, const fmfts_several_work *work,
                    double *shear_n, double *deviation_n)
{
    enum { MOST = 2 * FMFTS_SEVERAL_FINGERS };
    size_t columns = 2 * fingers.count, unknowns = FMFTS_FINGER * fingers.count;
    double white[FMFTS_SEVERAL_VALUES * MOST];
    bool known = fmfts_finite(unknowns * unknowns, covariance);
    for (size_t v = 0; v < work->used; v++) {
        for (size_t i = 0; i < columns; i++) {
            white[v * columns + i] = shear_column(model, work, i)[work->index[v]];
        }
    }
    fmfts_solve_lower(work->used, columns, work->root, white);
    for (size_t i = 0; i < columns; i++) {
        double along = 0.0, size = 0.0, by_finger[FMFTS_SEVERAL_UNKNOWNS], spent = 0.0;
        double prior_n = model->head->friction * fingers.at[FMFTS_FINGER * (i / 2) + 2];
        for (size_t v = 0; v < work->used; v++) {
            along += white[v * columns + i] * work->white[v];
            size += white[v * columns + i] * white[v * columns + i];
        }
        for (size_t k = 0; k < unknowns; k++) {
            by_finger[k] = 0.0;
            for (size_t v = 0; v < work->used; v++) {
                by_finger[k] += work->slope[v * unknowns + k] * white[v * columns + i];
            }
        }
        for (size_t k = 0; k < unknowns; k++) {
            double row = 0.0;
            for (size_t j = 0; j < unknowns; j++) {
                row += by_finger[j] * covariance[j * unknowns + k];
            }
            spent += row * by_finger[k];
        }
        double share = 1.0 - size + spent;
        shear_n[i] = known ? prior_n * along : 0.0;
        deviation_n[i] = known ? prior_n * sqrt(share > 0.0 ? share : 0.0) : prior_n;
    }
}
