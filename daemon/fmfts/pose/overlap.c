/* What both a frame's covariance and the baseline's leftovers contain: overlap.py explains it. */
#include <string.h>

#include "model.h"
#include "step.h"

static const double NEGLIGIBLE = 1e-3; /* see overlap.py */

enum { SOLVED = GRADIENT_COLUMN }; /* the columns that a frame may estimate come first: pose, moment, ambient field */

/* The rows of the pose in the covariance of the estimated columns, without what a considered moment adds. Zero elsewhere:
 * loops of constant length are fast. */
static void rows_of_pose(const fmfts_pose_parameters *parameters, const double *covariance, double own[5][SOLVED])
{
    double moment = parameters->part[LOG_COLUMN] == FMFTS_CONSIDERED ? covariance[(FMFTS_STEP + 1) * LOG_COLUMN] : 0.0;
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

/* Whether what the baseline leaves unknown is too small a part of every measurement to matter: mostly at rest. */
static bool is_negligible(const fmfts_pose_parameters *parameters, const fmfts_field *field)
{
    for (int axis = 0; axis < 3 * (int)parameters->sensors[0]; axis++) {
        if (field->unknown_t2[axis] > NEGLIGIBLE * field->variance_t2[axis]) {
            return false;
        }
    }
    return true;
}

void fmfts_overlap(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const fmfts_field *field,
                   const double slopes[][FMFTS_STEP], double overlap[5][5])
{
    double own[5][SOLVED], sum[5][5] = {{0}};
    if (is_negligible(parameters, field)) {
        memset(overlap, 0, sizeof sum);
        return;
    }
    rows_of_pose(parameters, memory->covariance, own);
    for (int axis = 0; axis < 3 * (int)parameters->sensors[0]; axis++) {
        double moved[5], variance = field->variance_t2[axis], weight = field->unknown_t2[axis] / (variance * variance);
        for (int i = 0; i < 5; i++) {
            moved[i] = 0.0;
            for (int c = 0; c < SOLVED; c++) {
                moved[i] += own[i][c] * slopes[axis][c];
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
