/* A healthy frame, from counts to the numbers of its message: the C of Estimator.read and contact_message.py. */
#ifndef FMFTS_FRAME_STEP_H
#define FMFTS_FRAME_STEP_H

#include <stddef.h>

#include "tables.h"

typedef struct {
    fmfts_memory next; /* what the frame leaves to the one after it, if its contact is a number */
    double instant_us; /* the device's time of the estimate */
    fmfts_numbers numbers;
} fmfts_outcome;

/* FMFTS_NO_NUMBER where the frame is not healthy. readings_bytes: as many as belong to the pad's sensors. response: of a
 * model that refines, else NULL. */
fmfts_kind fmfts_frame_step(const fmfts_parameters *parameters, const fmfts_memory *memory, const fmfts_frame *frame,
                            size_t readings_bytes, const fmfts_network *network, const void *response,
                            size_t response_bytes, fmfts_outcome *outcome);

#endif
