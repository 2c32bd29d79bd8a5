/* The pose and its rate at the newest sample, from each chip's samples at their own times: motion.py explains it. */
#ifndef FMFTS_MOTION_H
#define FMFTS_MOTION_H

#include "step.h"

enum { FMFTS_MOTION_STATES = 13, FMFTS_MODES = 2, FMFTS_RATE = 5, FMFTS_AMBIENT_CHANGE = 10 };

#define FMFTS_MOTION_PARAMETERS(X)                                                                                     \
    X(weights, FMFTS_MODES)                                                                                            \
    X(switches_per_s, 1)                                                                                               \
    X(calm_s, 1)                                                                                                       \
    X(lasting_share, 1)                                                                                                \
    X(largest_tilt, 1)                                                                                                 \
    X(surprise_chi2, 1)                                                                                                \
    X(early_chi2, 1)                                                                                                   \
    X(late_us, 1)

#define FMFTS_MOTION_MEMORY(X)                                                                                         \
    X(motion_us, 1)                                                                                                    \
    X(motion_state, FMFTS_MOTION_STATES)                                                                                     \
    X(motion_covariance, FMFTS_MOTION_STATES * FMFTS_MOTION_STATES)                                                    \
    X(modes, FMFTS_MODES)                                                                                              \
    X(followed, 1)                                                                                                     \
    X(early_us, FMFTS_SENSORS)                                                                                         \
    X(early_from_us, 1)                                                                                                \
    X(early_modes, FMFTS_MODES)                                                                                        \
    X(early_state, FMFTS_MODES * FMFTS_MOTION_STATES)                                                                  \
    X(early_covariance, FMFTS_MODES * FMFTS_MOTION_STATES * FMFTS_MOTION_STATES)                                       \
    X(early_chi2_sum, FMFTS_MODES)                                                                                     \
    X(early_widths, FMFTS_MODES)

FMFTS_STRUCT(fmfts_motion_parameters, FMFTS_MOTION_PARAMETERS)
FMFTS_STRUCT(fmfts_motion_memory, FMFTS_MOTION_MEMORY)

/* Takes the fresh samples (bit i of `fresh`: of sensor i) that `pose` holds, but for those that came before their frame. drive
 * [5][5]: W of motion.py. False if the filter does not run, or if the samples contradict what was predicted. */
bool fmfts_follow(const fmfts_pose_parameters *parameters, const fmfts_motion_parameters *own,
                  const fmfts_pose_memory *pose, unsigned fresh, const double *drive, fmfts_motion_memory *memory);

/* Whether a sample that came before its frame goes on from those that the filter took. */
bool fmfts_is_next(const fmfts_motion_parameters *own, const fmfts_motion_memory *memory, int sensor, double time_us);

/* Takes one sensor's sample (field_t [3], as measured) that came before its frame and is next. Otherwise as fmfts_follow. */
bool fmfts_follow_early(const fmfts_pose_parameters *parameters, const fmfts_motion_parameters *own,
                        const fmfts_pose_memory *pose, int sensor, const double *field_t, double time_us,
                        const double *drive, fmfts_motion_memory *memory);

/* The pose after a change [5] from rest. turn: derivative of the axis by the tilt. */
void fmfts_pose_after(const fmfts_pose_parameters *parameters, const double *change, double position[3], double axis[3],
                      double turn[2][3]);

#endif
