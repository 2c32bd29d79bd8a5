/* A frame that the fingers of the last one explain. */
#ifndef FMFTS_ORDINARY_H
#define FMFTS_ORDINARY_H

#include "fit.h"
#include "since_rest.h"

enum { FMFTS_ORDINARY_FINGERS = 2 };

/* most_chi2: of a frame with so many fingers. unfelt: as UNFELT of poses.py. */
typedef struct {
    double most_chi2[FMFTS_ORDINARY_FINGERS + 1];
    fmfts_valley_limits valley;
    double unfelt[FMFTS_POSE_CHANGE];
} fmfts_ordinary_limits;

/* has_jumped: as fmfts_since_rest says. has_fit: `fit` is of the fingers of before. is_ordinary: it needs no closer look; of
 * fingers, poses and valley are then filled. */
typedef struct {
    bool has_jumped, has_fit, is_ordinary;
    fmfts_found fit;
    fmfts_valley_found valley;
    fmfts_poses poses;
} fmfts_ordinary;

/* What the frame before tells: its fingers, and the field around [3]. */
typedef struct {
    fmfts_fingers fingers;
    const double *ambient_t;
} fmfts_frame_before;

/* ordinary.c: the steps of a frame. samples->now_t is set. */
void fmfts_read_ordinary(const fmfts_fitter *fitter, const fmfts_ordinary_limits *limits, const fmfts_frame_before *last,
                         fmfts_rest_samples *samples, const fmfts_rest_change *change, fmfts_ordinary *found);

/* What pipeline/_calm.c calls of this module: its functions are compiled once, for vectors. */
typedef struct {
    bool (*view_model)(const double *packed, size_t count, fmfts_several *model);
    bool (*view_search)(const double *packed, size_t count, size_t values, fmfts_search *search);
    void (*read_ordinary)(const fmfts_fitter *fitter, const fmfts_ordinary_limits *limits, const fmfts_frame_before *last,
                          fmfts_rest_samples *samples, const fmfts_rest_change *change, fmfts_ordinary *found);
    void (*look_ahead)(const fmfts_several *model, const fmfts_ahead *from, fmfts_several_work *work, double *ahead_t,
                       double *by_finger);
} fmfts_several_steps;

#define FMFTS_SEVERAL_STEPS "fmfts.several._several.STEPS" /* the capsule of them */

#endif
