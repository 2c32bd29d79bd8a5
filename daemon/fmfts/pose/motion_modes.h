/* Internal to the filter behind `now`: what motion.c shares with motion_modes.c. */
#ifndef FMFTS_MOTION_MODES_H
#define FMFTS_MOTION_MODES_H

#include "motion.h"

/* chi2: sum of ν²/s. widths: product of s/r. */
typedef struct {
    double x[FMFTS_MOTION_STATES], p[FMFTS_MOTION_STATES][FMFTS_MOTION_STATES], chi2, widths;
} fmfts_mode;

/* motion_modes.c: takes a sensor's sample in every mode, and notes its time. False if the filter is lost. */
bool fmfts_take_sample(const fmfts_driven *driven, const fmfts_early *sample, fmfts_mode modes[FMFTS_MODES],
                       fmfts_motion_memory *memory);

/* motion_modes.c: the modes as one state. shares: the modes' probabilities `elapsed_s` ago. */
void fmfts_merge(const fmfts_motion_parameters *own, double elapsed_s, const fmfts_mode *modes, const double *shares,
                 fmfts_motion_memory *memory);

/* motion_modes.c: whether a state tilts the magnet no further than a press can. */
bool fmfts_is_upright(const double *x);

#endif
