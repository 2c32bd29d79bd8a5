/* The contact at the time of publishing: drive.py and now.py. */
#ifndef FMFTS_NOW_H
#define FMFTS_NOW_H

#include "step.h"

#define FMFTS_NOW_PARAMETERS(X)                                                                                        \
    X(tells_now, 1)             /* 0: the pad's response is not known */                                               \
    X(period_us, 1)             /* pipeline/now.py */                                                                  \
    X(lead_us, 1)                                                                                                      \
    X(early_lead_us, 1)                                                                                                \
    X(let_go, 1)                                                                                                       \
    X(jump_periods, 1)                                                                                                 \
    X(settled_frames, 1)                                                                                               \
    X(longest_lead_s, 1)                                                                                               \
    X(to_pose, FMFTS_MOVED * FMFTS_MOVED)          /* drive.py */                                                      \
    X(untouched_drive, FMFTS_MOVED * FMFTS_MOVED)                                                                      \
    X(drive_power, FMFTS_CONTACT)                                                                                      \
    X(usual_rate, FMFTS_CONTACT)                   /* now.py: m/s and N/s */                                           \
    X(acceleration_power, FMFTS_CONTACT)                                                                               \
    X(lead_share, 1)                                                                                                   \
    X(ahead_s, 1)

#define FMFTS_NOW_MEMORY(X) X(made_us, 1) X(told_us, 1)

FMFTS_STRUCT(fmfts_now_parameters, FMFTS_NOW_PARAMETERS)
FMFTS_STRUCT(fmfts_now_memory, FMFTS_NOW_MEMORY)

/* Place (m), force and shears (N), their rates per second, and the deviations of both. */
typedef struct {
    int outputs;
    double value[FMFTS_CONTACT], deviation[FMFTS_CONTACT], rate[FMFTS_CONTACT], rate_deviation[FMFTS_CONTACT];
} fmfts_contact_now;

/* drive.c: W [5][5] at the last contact. estimate: NULL if nothing touches the pad. False if there is no response. */
bool fmfts_drive(const fmfts_now_parameters *parameters, const void *response, size_t response_bytes,
                 const fmfts_estimate *estimate, double *drive);

/* now.c: shrinks the rates, whose variances are in rate_deviation. moving: probability that the finger moves. */
void fmfts_shrink(const fmfts_now_parameters *parameters, double moving, fmfts_contact_now *now);

/* now.c: carries the contact on by lead_s. pressed: whether the magnet is certainly below its rest. */
void fmfts_carry(const fmfts_now_parameters *parameters, double lead_s, bool pressed, fmfts_contact_now *now);

#endif
