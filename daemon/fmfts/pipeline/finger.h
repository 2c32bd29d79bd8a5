/* `now` of a pad with several magnets, while one finger presses: the filter of pose/motion.c follows the finger in place of the pose. */
#ifndef FMFTS_FINGER_H
#define FMFTS_FINGER_H

#include "../several/ordinary.h"
#include "frame.h"

enum { FMFTS_FINGER_NUMBERS = 3 }; /* x and y in mm, force in N */

/* The result of the last frame. pressing: 1: one finger; 0: nothing; negative: unknown. places: whether its message
 * reports a contact. finger: the point of linearisation, and the filter's start. ahead_t, by_finger: what each axis
 * reads at that finger, baseline subtracted, and its derivative. deviation: of the finger, for all causes;
 * untouched_us: the instant of the last frame, if nothing pressed in it; else 0. taken_us: of each sensor's newest
 * sample. */
#define FMFTS_FINGER_MEMORY(ONE, MANY)                                                                                 \
    ONE(double, pressing)                                                                                              \
    ONE(double, places)                                                                                                \
    ONE(double, instant_us)                                                                                            \
    ONE(double, untouched_us)                                                                                          \
    MANY(double, finger, FMFTS_FINGER_NUMBERS)                                                                         \
    MANY(double, finger_covariance, FMFTS_FINGER_NUMBERS * FMFTS_FINGER_NUMBERS)                                       \
    MANY(double, finger_deviation, FMFTS_FINGER_NUMBERS)                                                               \
    MANY(double, ahead_t, FMFTS_AXES)                                                                                  \
    MANY(double, by_finger, FMFTS_FINGER_NUMBERS * FMFTS_AXES)                                                         \
    MANY(int64_t, taken_us, FMFTS_SENSORS)

FMFTS_STRUCT(fmfts_finger_memory, FMFTS_FINGER_MEMORY)

#define FMFTS_FOLLOWED_MEMORY(ONE, MANY)                                                                               \
    FMFTS_FINGER_MEMORY(ONE, MANY)                                                                                     \
    FMFTS_MOTION_MEMORY(ONE, MANY)                                                                                     \
    FMFTS_NOW_MEMORY(ONE, MANY)
typedef struct {
    fmfts_finger_memory finger;
    fmfts_motion_memory motion;
    fmfts_now_memory now;
} fmfts_followed_memory;

/* A frame's newest samples as measured [sensors][3], their times, and which are new (bit i: of sensor i). */
typedef struct {
    int64_t sequence, time_us;
    unsigned fresh;
    const double *field_t;
    const int64_t *sampled_us;
} fmfts_finger_frame;

/* finger.c: the finger to follow is the one that a fit found in a frame, or a sample, of this time. The field is linear where the
 * newest samples should find it: at a tap it has moved on since the frame's instant. from: all but `there` and light_n. False where
 * that is no finite place. */
bool fmfts_put_finger(const fmfts_fitter *fitter, fmfts_ahead *from, const double *covariance, int64_t time_us,
                      const fmfts_several_steps *steps, fmfts_followed_memory *memory);

/* finger.c: takes the samples of a frame that was judged: memory->finger holds its result, except for taken_us. `now`
 * is unknown if the samples contradict the prediction, or if it is unknown what presses. */
void fmfts_follow_finger(const fmfts_parameters *parameters, fmfts_followed_memory *memory, const fmfts_finger_frame *frame,
                         fmfts_now *now);

/* finger.c: takes a sample that came before its frame. `now` is unknown if the sample is not new. */
void fmfts_follow_finger_early(const fmfts_parameters *parameters, fmfts_followed_memory *memory, const fmfts_early *early,
                               fmfts_now *now);

#endif
