/* The errors that both a frame's covariance and the baseline's leftovers contain.
 *
 * The chips' errors that the baseline leaves are in the deviation of each measurement, which gives uncertain
 * measurements less weight. So they are in the frame's covariance C, as if they were new in each measurement. The error
 * of a change of pose (change_error) has the same causes, with their correlations. Only one of the two may count. With
 * H the slopes of the measurements, W their weights, and L² the lasting part of their variances (unknown_t2), a frame's
 * estimate moves by C·Hᵀ·W per measurement, so the part of C to take away is
 *
 *     C·Hᵀ·W·L²·W·H·C
 *
 * With N² the other part of the variances and Ω the prior's information, C·(HᵀWH + Ω)·C = C and W = (N² + L²)⁻¹. So
 * what is left of C is C·(HᵀW·N²·WH + Ω)·C: it never has a negative variance. */
#include <string.h>

#include "model.h"
#include "step.h"

/* A smaller share in every measurement is not removed: it would change deviations by half a thousandth. */
static const double NEGLIGIBLE = 1e-3;

enum { SOLVED = GRADIENT_COLUMN }; /* the columns that a frame may estimate come first: pose, moment, ambient field */

/* The rows of the pose in the covariance of the estimated columns, without what the moment adds, if that is given. Zero elsewhere:
 * loops of constant length are fast. */
static void rows_of_pose(const fmfts_pose_parameters *parameters, const double *covariance, bool given, double own[5][SOLVED])
{
    double moment = given ? covariance[(FMFTS_STEP + 1) * LOG_COLUMN] : 0.0;
    for (int c = 0; c < SOLVED; c++) {
        bool estimated = parameters->part[c] == FMFTS_FREE || parameters->part[c] == FMFTS_PRIOR;
        for (int i = 0; i < 5; i++) {
            const double *row = covariance + FMFTS_STEP * i;
            own[i][c] = estimated ? row[c] : 0.0;
            if (estimated && moment > 0.0) {
                own[i][c] -= row[LOG_COLUMN] * covariance[FMFTS_STEP * c + LOG_COLUMN] / moment;
            }
        }
    }
}

/* Whether the baseline's uncertainty is negligible in every measurement: mostly at rest. */
static bool is_negligible(const fmfts_pose_parameters *parameters, const fmfts_field *field)
{
    for (int axis = 0; axis < 3 * (int)parameters->sensors; axis++) {
        if (field->unknown_t2[axis] > NEGLIGIBLE * field->variance_t2[axis]) {
            return false;
        }
    }
    return true;
}

void fmfts_overlap(const fmfts_step *step, bool moment_is_given, double overlap[5][5])
{
    const fmfts_pose_parameters *parameters = step->parameters;
    const fmfts_field *field = &step->field;
    double own[5][SOLVED], sum[5][5] = {{0}};
    if (is_negligible(parameters, field)) {
        memset(overlap, 0, sizeof sum);
        return;
    }
    rows_of_pose(parameters, step->memory->covariance, moment_is_given, own);
    for (int axis = 0; axis < 3 * (int)parameters->sensors; axis++) {
        double moved[5], variance = field->variance_t2[axis], weight = field->unknown_t2[axis] / (variance * variance);
        for (int i = 0; i < 5; i++) {
            moved[i] = 0.0;
            for (int c = 0; c < SOLVED; c++) {
                moved[i] += own[i][c] * step->slopes[axis][c];
            }
            for (int j = 0; j <= i; j++) {
                sum[i][j] += weight * moved[i] * moved[j];
            }
        }
    }
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j <= i; j++) {
            overlap[i][j] = overlap[j][i] = sum[i][j];
        }
    }
}
