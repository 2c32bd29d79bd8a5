/* The mean residual of each axis of a pad: mean_residuals.c averages and judges them, blame.c finds what is wrong. */
#ifndef FMFTS_MEAN_RESIDUALS_H
#define FMFTS_MEAN_RESIDUALS_H

#include "model.h"
#include "step.h"

/* The mean of residuals shows 20 nT, and offsets of chips drift by some 10 nT/K: beyond this change of temperature they
 * may be the cause. */
#define FMFTS_WARMED_K 5.0

/* The verdict: a faulty sensor (negative: no single one), or a foreign field, which explains the mean better. Without
 * both, one of the suspects (mask) is faulty. */
typedef struct {
    bool is_wrong, foreign;
    int sensor;
    unsigned suspects;
} fmfts_finding;

/* Some axes of a pad as one problem of generalised least squares: V is the covariance of their errors, J the derivatives of
 * their prediction by the unknowns. Both matrices are factored as algebra.h does it. */
typedef struct {
    size_t axes, unknowns;
    int axis[FMFTS_AXES]; /* of the pad */
    double jacobian[FMFTS_STEP][FMFTS_AXES];
    double covariance[FMFTS_AXES][FMFTS_AXES]; /* V */
    double solved[FMFTS_STEP][FMFTS_AXES];     /* V⁻¹J */
    fmfts_matrix normal;                       /* JᵀV⁻¹J */
} fmfts_judged_axes;

/* mean_residuals.c: begins anew. */
void fmfts_forget_means(fmfts_pose_memory *memory);

/* mean_residuals.c: adds a frame's residuals [axes], NaN where an axis is silent. True if it is time to judge the means. */
bool fmfts_push_means(fmfts_step *step, const double *residual_t);

/* mean_residuals.c: what is wrong by the means. A fault that was found before counts as over only once the mean is sound. */
fmfts_finding fmfts_judge_means(fmfts_step *step);

/* mean_residuals.c: values of the judged axes times R = V⁻¹ − V⁻¹J(JᵀV⁻¹J)⁻¹JᵀV⁻¹. */
void fmfts_weigh(fmfts_judged_axes *judged, const double *value, double *weighed);

/* mean_residuals.c: whether the mean is that of healthy sensors if each axis's own variance own_t2 [axes] has added_t2 more. common:
 * the covariance of the errors that they have in common. */
bool fmfts_explains_mean(const fmfts_step *step, double common[][FMFTS_AXES], const double *own_t2, double added_t2);

/* further_drift.c: whether a further drift explains a mean that is not that of healthy sensors; then it counts from now on. */
bool fmfts_drifts_further(fmfts_step *step, double common[][FMFTS_AXES], const double *own_t2);

/* further_drift.c: lets the drift fall to the next smaller figure once that has explained the mean for long. */
void fmfts_drifts_less(fmfts_step *step, double common[][FMFTS_AXES], const double *own_t2);

/* blame.c: what is wrong with a mean that is not that of healthy sensors. mean_t: of the judged axes. */
fmfts_finding fmfts_blame(const fmfts_step *step, fmfts_judged_axes *judged, const double *mean_t);

#endif
