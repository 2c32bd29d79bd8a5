/* A healthy frame, from counts to the numbers of its message. The reference is Estimator.read and contact_message.py. */
#ifndef FMFTS_FRAME_STEP_H
#define FMFTS_FRAME_STEP_H

#include <stddef.h>

#include "tables.h"

/* What the last frame says of the samples that come before the next: _Judged of pipeline/now.py. moment: the covariance of
 * the magnet's moment with the pose, and its variance. known: the rest means something. */
typedef struct {
    double drive[FMFTS_MOVED * FMFTS_MOVED], moment[FMFTS_MOVED + 1];
    int64_t known, over_range;
} fmfts_judged;

typedef struct {
    fmfts_memory next; /* the memory for the next frame; valid if this frame is healthy */
    double seen[FMFTS_MOVES * FMFTS_MOVES]; /* covariance of the magnet's pose, for pads that feel it */
    double instant_us; /* the board's time of the estimate */
    double now_us;     /* the board's time of `now` */
    fmfts_judged judged;
    fmfts_numbers numbers;
} fmfts_outcome;

/* One chip's sample that came before its frame. field_t: as measured. */
typedef struct {
    int sensor;
    double field_t[3], time_us;
} fmfts_early;

/* What becomes of it: it is not used; it is followed, and `now` is not known (it may contradict what was predicted: then the
 * filter has stopped); or `now` is told. */
typedef enum { FMFTS_UNUSED, FMFTS_FOLLOWED, FMFTS_TOLD } fmfts_news;

/* What both kinds of steps need of a pad besides its memory. response: as in refine.h, or NULL. own: where its magnet was last
 * seen. neighbour: the same of the pads that it feels. */
typedef struct {
    const fmfts_parameters *parameters;
    fmfts_network network;
    const void *response;
    size_t response_bytes;
    fmfts_sighting *own;
    const fmfts_sighting *neighbour[FMFTS_NEIGHBOURS];
} fmfts_pad;

/* Returns FMFTS_NO_NUMBER if the frame is not healthy. readings_bytes: size of frame->readings; must match the pad's number
 * of sensors. */
fmfts_kind fmfts_frame_step(const fmfts_pad *pad, const fmfts_memory *memory, const fmfts_frame *frame, size_t readings_bytes,
                            fmfts_outcome *outcome);

/* The host's time of the estimate, of a frame whose time is time_us on the board's clock and host_ns on the host's. */
int64_t fmfts_sampled_ns(int64_t host_ns, double time_us, double instant_us);

/* Goes on from a healthy frame, which was sampled at sampled_ns (host's clock): in `memory`, and for pads that feel this one. */
void fmfts_go_on(const fmfts_pad *pad, const fmfts_outcome *outcome, int64_t sampled_ns, fmfts_memory *memory);

/* frame_step.c: force_sd_n of contact_message.py. */
double fmfts_force_sd_n(const fmfts_message_parameters *parameters, const fmfts_estimate *estimate, const fmfts_contact_memory *touch);

/* now.c: writes `now` into the outcome. solved, last: the solver's pose, and the contact from it. False if it is not known. */
bool fmfts_tell_now(const fmfts_pad *pad, fmfts_memory *next, const fmfts_frame *frame, const fmfts_pose *solved,
                    const fmfts_estimate *last, fmfts_outcome *outcome);

/* now.c: the field of a sample as measured, NaN where an axis holds no measurement. */
void fmfts_read_early(const fmfts_pose_parameters *parameters, unsigned gain_code, const int16_t counts[3], double field_t[3]);

/* now.c: follows a sample that came before its frame, after a healthy frame, with the outcome of that frame. If `now` is told,
 * the outcome's numbers are those of its message. */
fmfts_news fmfts_early_step(const fmfts_pad *pad, fmfts_memory *memory, const fmfts_early *early, fmfts_outcome *outcome);

#endif
