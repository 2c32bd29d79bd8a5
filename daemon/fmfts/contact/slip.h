/* Whether the finger slips over the silicone: slip.c and friction.c explain it. */
#ifndef FMFTS_SLIP_H
#define FMFTS_SLIP_H

#include "step.h"

enum { FMFTS_SLIP_STATES = 9, FMFTS_SLIP_FILTERS = 3, FMFTS_STUCK = 0 };

/* tells_slip: 0: slip is not configured, and nothing of this file runs. slip_friction: smallest and largest friction
 * that the finger may have. */
#define FMFTS_SLIP_PARAMETERS(ONE, MANY)                                                                                       \
    ONE(double, tells_slip)                                                                                            \
    MANY(double, slip_friction, 2)

/* slip_frames: since the filters began; 0: they do not run. slip_score: of each filter, its recent log likelihood.
 * slip_since_s: since STUCK was put where the finger is; slip_speed: its expected speed, mm/s. slip_spread: variance of
 * STUCK's place along an axis when it was put there, mm².
 * first_…: shear (N) of the touch's first moments, with weight (1/variance) and duration.
 * learnt_…: of this touch's slips; weight: 1/deviation², 0
 * before the first one. */
#define FMFTS_SLIP_MEMORY(ONE, MANY)                                                                                           \
    ONE(double, slip_frames)                                                                                           \
    MANY(double, slip_state, FMFTS_SLIP_FILTERS *FMFTS_SLIP_STATES)                                                    \
    MANY(double, slip_covariance, FMFTS_SLIP_FILTERS *FMFTS_SLIP_STATES *FMFTS_SLIP_STATES)                            \
    MANY(double, slip_score, FMFTS_SLIP_FILTERS)                                                                       \
    ONE(double, slipping)                                                                                              \
    ONE(double, slip_since_s)                                                                                          \
    ONE(double, slip_speed)                                                                                            \
    ONE(double, slip_spread)                                                                                           \
    MANY(double, first_shear, 2)                                                                                       \
    ONE(double, first_weight)                                                                                          \
    ONE(double, first_s)                                                                                               \
    ONE(double, learnt_friction)                                                                                       \
    ONE(double, learnt_weight)

FMFTS_STRUCT(fmfts_slip_parameters, FMFTS_SLIP_PARAMETERS)
FMFTS_STRUCT(fmfts_slip_memory, FMFTS_SLIP_MEMORY)

/* A change of pose from rest, in the model's units, with the covariance of a frame's noise alone. elapsed_s: since the
 * last frame; 0: it has the same samples. shear_sd_n: other uncertainty of a shear, the same in all frames of a touch.
 * */
typedef struct {
    double elapsed_s, change[FMFTS_MOVED], noise[FMFTS_MOVED * FMFTS_MOVED], shear_sd_n;
} fmfts_slip_frame;

/* sticking: probability. speed, direction: of the finger over the silicone, if it slips. friction and margin (the
 * additional tangential force until it slips) are known after a slip in this touch. */
typedef struct {
    bool known, slipping, knows_friction;
    double sticking, speed_m_per_s, speed_sd_m_per_s, direction_rad, direction_sd_rad;
    double friction, friction_sd, margin_n, margin_sd_n;
} fmfts_slip;

/* slip.c: the finger may be gone, or another one. */
void fmfts_forget_slip(fmfts_slip_memory *memory);

/* slip.c: takes a frame of a contact into all filters. estimate: of the same frame, from which they begin. */
void fmfts_follow_slip(const fmfts_response *response, const fmfts_slip_frame *frame, const fmfts_estimate *estimate,
                       fmfts_slip_memory *memory);

/* slip.c: the place (2) at which STUCK explains the frame, and its covariance (2, 2). */
void fmfts_stuck_place(const fmfts_slip_memory *memory, double place[2], double covariance[2][2]);

/* slip.c: puts STUCK where the filter `which` has the finger now. held: the next frames do not move it. */
void fmfts_stick_here(int which, bool held, fmfts_slip_memory *memory);

/* friction.c: whether it slips, and its learnt friction. */
void fmfts_judge_slip(const fmfts_slip_parameters *parameters, const fmfts_slip_frame *frame, fmfts_slip_memory *memory,
                      fmfts_slip *slip);

#endif
