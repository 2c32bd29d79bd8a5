/* A healthy frame, from counts to the numbers of its message. The reference is Estimator.read and contact_message.py. */
#ifndef FMFTS_FRAME_STEP_H
#define FMFTS_FRAME_STEP_H

#include <stddef.h>

#include "tables.h"

typedef struct {
    fmfts_memory next; /* the memory for the next frame; valid if this frame is healthy */
    double instant_us; /* the board's time of the estimate */
    double now_us;     /* the board's time of `now` */
    fmfts_numbers numbers;
} fmfts_outcome;

/* Returns FMFTS_NO_NUMBER if the frame is not healthy. readings_bytes: size of frame->readings; must match the pad's number
 * of sensors. response: as in refine.h, or NULL. */
fmfts_kind fmfts_frame_step(const fmfts_parameters *parameters, const fmfts_memory *memory, const fmfts_frame *frame,
                            size_t readings_bytes, const fmfts_network *network, const void *response,
                            size_t response_bytes, fmfts_outcome *outcome);

/* frame_step.c: force_sd_n of contact_message.py. */
double fmfts_force_sd_n(const fmfts_message_parameters *parameters, const fmfts_estimate *estimate, bool touching);

/* now.c: writes `now` into the outcome. solved, last: the solver's pose, and the contact from it. False if it is not known. */
bool fmfts_tell_now(const fmfts_parameters *parameters, fmfts_memory *next, const fmfts_frame *frame,
                    const fmfts_pose *solved, const fmfts_estimate *last, const fmfts_network *network,
                    const void *response, size_t response_bytes, fmfts_outcome *outcome);

#endif
