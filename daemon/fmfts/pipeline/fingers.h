/* From what several fingers, or the poses of several magnets, are estimated to be, to their message. */
#ifndef FMFTS_FINGERS_H
#define FMFTS_FINGERS_H

#include "finger.h"

enum { FMFTS_TOLD_CAUSES = 96 }; /* of errors of a baseline: as many as several/several.h has */

/* What the messages of a mounted pad need. magnets: how many. rest_variance: of each one's position, tilt and log moment.
 * ambient_t: at the baseline, NaN if it was not measured. ambient_error [3][causes][3]: what the baseline's errors make of the mean
 * over the sensors of a unit field; ambient_noise_t2: of that mean. silicone_share: by which share of its force silicone creeps, or
 * the cast varies. quiet_force_sd_n: of the force on an untouched pad. scale_n: the table's largest force. */
#define FMFTS_MOUNTED_PARAMETERS(ONE, MANY)                                                                            \
    ONE(double, magnets)                                                                                               \
    MANY(double, rest_variance, 6 * FMFTS_TOLD_MAGNETS)                                                                \
    MANY(double, remanence_t, FMFTS_TOLD_MAGNETS)                                                                      \
    MANY(double, remanence_deviation_t, FMFTS_TOLD_MAGNETS)                                                            \
    MANY(double, ambient_t, 3)                                                                                         \
    MANY(double, ambient_deviation_t, 3)                                                                               \
    ONE(double, causes)                                                                                                \
    MANY(double, ambient_error, 9 * FMFTS_TOLD_CAUSES)                                                                 \
    MANY(double, ambient_noise_t2, 3)                                                                                  \
    ONE(double, silicone_share)                                                                                        \
    ONE(double, quiet_force_sd_n)                                                                                      \
    ONE(double, scale_n)

FMFTS_STRUCT(fmfts_mounted_parameters, FMFTS_MOUNTED_PARAMETERS)

/* What is found of a frame, of which its message and its `now` are made: by C of a calm one (_calm.c), else by Python (found.py).
 * has_fingers: with `count` fingers, which may be none; else contact: 1, 0, or −1: not known. more: no two fingers explain the field.
 * over_range: they are beyond the table. displacement: of the magnet that moved most, NaN: not told. moment: the factor on all moments.
 * change_t, variance_t2: the field's change since rest; used: of which axes the frame was made. fingers … slope_t: as Fit has them.
 * least: see several/resultant.h. position, axis, variance: of the magnets, and of their change since rest. */
#define FMFTS_FRAME_FOUND(ONE, MANY)                                                                                   \
    ONE(int64_t, has_fingers)                                                                                          \
    ONE(int64_t, has_least)                                                                                            \
    ONE(int64_t, has_magnets)                                                                                          \
    ONE(int64_t, contact)                                                                                              \
    ONE(int64_t, more)                                                                                                 \
    ONE(int64_t, over_range)                                                                                           \
    ONE(int64_t, count)                                                                                                \
    MANY(int64_t, id, FMFTS_TOLD_FINGERS)                                                                              \
    ONE(double, chi2)                                                                                                  \
    ONE(double, moment)                                                                                                \
    ONE(double, displacement_m)                                                                                        \
    ONE(double, displacement_sd_m)                                                                                     \
    MANY(double, change_t, FMFTS_AXES)                                                                                 \
    MANY(double, variance_t2, FMFTS_AXES)                                                                              \
    MANY(uint8_t, used, FMFTS_AXES)                                                                                    \
    MANY(double, fingers, FMFTS_FINGER_NUMBERS * FMFTS_TOLD_FINGERS)                                                   \
    MANY(double, covariance, FMFTS_FINGER_NUMBERS * FMFTS_TOLD_FINGERS * FMFTS_FINGER_NUMBERS * FMFTS_TOLD_FINGERS)    \
    MANY(double, misfit_t, FMFTS_AXES)                                                                                 \
    MANY(double, ambient_t, 3)                                                                                         \
    MANY(double, shear_n, 2 * FMFTS_TOLD_FINGERS)                                                                      \
    MANY(double, shear_deviation_n, 2 * FMFTS_TOLD_FINGERS)                                                            \
    MANY(double, noise_t, FMFTS_AXES)                                                                                  \
    MANY(double, slope_t, FMFTS_AXES * FMFTS_FINGER_NUMBERS * FMFTS_TOLD_FINGERS)                                      \
    MANY(double, least, FMFTS_FINGER_NUMBERS * (1 + FMFTS_TOLD_FINGERS))                                               \
    MANY(double, position, 3 * FMFTS_TOLD_MAGNETS)                                                                     \
    MANY(double, axis, 3 * FMFTS_TOLD_MAGNETS)                                                                         \
    MANY(double, variance, FMFTS_POSE_CHANGE * FMFTS_TOLD_MAGNETS)

FMFTS_STRUCT(fmfts_frame_found, FMFTS_FRAME_FOUND)

/* What a frame is judged with: views of Python's arrays. steps … followed: NULL unless C judges calm frames. rest: of fmfts_samples_of.
 * untouched: position, axis [magnets][3] and variance [magnets][5] of the magnets at rest, and by how much [values] a sample must
 * change until a finger is looked for in it. */
typedef struct {
    const fmfts_mounted_parameters *mounted;
    fmfts_frame_found *found;
    const fmfts_several_steps *steps;
    fmfts_several model;
    fmfts_search search;
    fmfts_several_work *work;
    const fmfts_ordinary_limits *limits;
    const double *rest, *untouched;
    fmfts_followed_memory *followed;
} fmfts_bound;

/* fingers.c: the fields of the message of a pad with `sensors`, but for health, reason, temperature and `now`. `several`: where it
 * has its own. */
void fmfts_tell_found(const fmfts_mounted_parameters *mounted, const fmfts_frame_found *found, size_t sensors,
                      fmfts_told_several *several, fmfts_reading *reading);

#endif
