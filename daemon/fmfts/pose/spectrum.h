/* The frequency with which the ambient field of the last frames alternates. */
#ifndef FMFTS_SPECTRUM_H
#define FMFTS_SPECTRUM_H

#include "step.h"

/* hz: as sampled, below half of the frames' rate; 0: none. amplitude_t: along all axes together. */
typedef struct {
    double hz, amplitude_t;
} fmfts_line;

/* spectrum.c: the strongest line in the ring of the last FMFTS_RING ambient fields [frames][3]; noise alone exceeds
 * parameters->line_chi2 seldom (gates.py). */
fmfts_line fmfts_strongest_line(const fmfts_pose_parameters *parameters, const double *ring_t);

/* spectrum.c: names the source of the alternating field: mains, if the frequency fits, or else the observed frequency.
 * */
void fmfts_say_line(const fmfts_pose_parameters *parameters, const fmfts_line *line, fmfts_text *text);

#endif
