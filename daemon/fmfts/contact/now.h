/* The contact at the time of publishing: drive.py has the model, pipeline/now.c the filter. */
#ifndef FMFTS_NOW_H
#define FMFTS_NOW_H

#include "step.h"

#define FMFTS_NOW_PARAMETERS(ONE, MANY)                                                                                        \
    ONE(double, tells_now) /* 0: the pad's response is not known */                                                    \
    ONE(double, lead_us)                                                                                               \
    ONE(double, early_lead_us)                                                                                         \
    MANY(double, to_pose, FMFTS_MOVED * FMFTS_MOVED) /* drive.py */                                                    \
    MANY(double, untouched_drive, FMFTS_MOVED * FMFTS_MOVED)                                                           \
    MANY(double, drive_power, FMFTS_CONTACT)

/* made_us: the time of frame 0 on the board's clock, extrapolated from recent frames. told_us: the time for which the
 * last `now` held. */
#define FMFTS_NOW_MEMORY(ONE, MANY) ONE(double, made_us) ONE(double, told_us)

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

/* now.c: extrapolates the contact by lead_s. pressed: whether the magnet is certainly below its rest. */
void fmfts_carry(double lead_s, bool pressed, fmfts_contact_now *now);

#endif
