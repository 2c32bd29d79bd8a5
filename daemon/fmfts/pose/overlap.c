/* What both a frame's covariance and the baseline's leftovers contain: overlap.py explains it. */
#include "model.h"
#include "step.h"

/* The rows of the pose in the covariance of the estimated columns `order`, without what a considered moment adds. */
static void rows_of_pose(const fmfts_pose_parameters *parameters, const double *covariance, int count, const int *order,
                         double own[5][FMFTS_STEP])
{
    double moment = parameters->part[LOG_COLUMN] == FMFTS_CONSIDERED ? covariance[(FMFTS_STEP + 1) * LOG_COLUMN] : 0.0;
    for (int i = 0; i < 5; i++) {
        const double *row = covariance + FMFTS_STEP * i;
        for (int j = 0; j < count; j++) {
            own[i][j] = row[order[j]];
            if (moment > 0.0) {
                own[i][j] -= row[LOG_COLUMN] * covariance[FMFTS_STEP * order[j] + LOG_COLUMN] / moment;
            }
        }
    }
}

void fmfts_overlap(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const fmfts_field *field,
                   const double slopes[][FMFTS_STEP], double overlap[5][5])
{
    double own[5][FMFTS_STEP];
    int order[FMFTS_STEP], count = 0;
    for (int c = 0; c < GRADIENT_COLUMN; c++) {
        if (parameters->part[c] == FMFTS_FREE || parameters->part[c] == FMFTS_PRIOR) {
            order[count++] = c;
        }
    }
    rows_of_pose(parameters, memory->covariance, count, order, own);
    for (int i = 0; i < 25; i++) {
        overlap[i / 5][i % 5] = 0.0;
    }
    for (int axis = 0; axis < 3 * (int)parameters->sensors[0]; axis++) {
        double moved[5], variance = field->variance_t2[axis], weight = field->unknown_t2[axis] / (variance * variance);
        for (int i = 0; i < 5; i++) {
            moved[i] = 0.0;
            for (int j = 0; j < count; j++) {
                moved[i] += own[i][j] * slopes[axis][order[j]];
            }
            for (int j = 0; j <= i; j++) {
                overlap[i][j] += weight * moved[i] * moved[j];
            }
        }
    }
    for (int i = 0; i < 5; i++) {
        for (int j = 0; j < i; j++) {
            overlap[j][i] = overlap[i][j];
        }
    }
}
