/* Where the magnets are as fingers put them: told_poses.py explains it. */
#include "several.h"

void fmfts_told_poses(const fmfts_several *model, size_t fingers, const double *finger, const double *covariance,
                      fmfts_predicted *predicted, double *position, double *axis, double *variance)
{
    size_t poses = model->poses, unknowns = FMFTS_FINGER * fingers;
    fmfts_predict(model, fingers, finger, predicted);
    for (size_t p = 0; p < poses; p++) {
        double by_finger[FMFTS_SEVERAL_UNKNOWNS] = {0.0}, unit = model->head->unit[p % FMFTS_POSE_CHANGE];
        for (size_t u = 0; u < unknowns; u++) {
            by_finger[u] = predicted->pressed[u / FMFTS_FINGER][poses + FMFTS_FINGER * p + u % FMFTS_FINGER] * unit;
        }
        variance[p] = 0.0;
        for (size_t u = 0; u < unknowns; u++) {
            double sum = 0.0;
            for (size_t k = 0; k < unknowns; k++) {
                sum += by_finger[k] * covariance[k * unknowns + u];
            }
            variance[p] += sum * by_finger[u];
        }
    }
    for (size_t magnet = 0; magnet < model->magnets; magnet++) {
        fmfts_moved_magnet(model, magnet, predicted->change, position + 3 * magnet, axis + 3 * magnet);
    }
}
