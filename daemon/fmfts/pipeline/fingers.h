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

/* Of several/fit.h: finger [count][3] in mm and N, and its covariance; shear and its deviation [count][2]. least: see
 * several/resultant.h. */
typedef struct {
    size_t count;
    int64_t id[FMFTS_TOLD_FINGERS];
    const double *finger, *covariance, *shear_n, *shear_deviation_n, *least;
} fmfts_fingers_found;

/* position, axis [magnets][3]; variance [magnets][5]: of their change since rest. misfit_t, used [axes]: residuals, and of which axes
 * the frame was made. ambient_t: the change of the ambient field, NULL: not told. */
typedef struct {
    const double *position, *axis, *variance, *misfit_t;
    const uint8_t *used;
    const double *ambient_t;
    double chi2;
} fmfts_magnets_found;

/* What C finds of a frame, for Python where the frame needs a closer look: as Measured and Fit have it. */
#define FMFTS_CALM_ROOM(ONE, MANY)                                                                                     \
    MANY(double, change_t, FMFTS_AXES)                                                                                 \
    MANY(double, variance_t2, FMFTS_AXES)                                                                              \
    MANY(uint8_t, there, FMFTS_AXES)                                                                                   \
    MANY(double, fingers, FMFTS_FINGER_NUMBERS * FMFTS_TOLD_FINGERS)                                                   \
    MANY(double, covariance, FMFTS_FINGER_NUMBERS * FMFTS_TOLD_FINGERS * FMFTS_FINGER_NUMBERS * FMFTS_TOLD_FINGERS)    \
    MANY(double, misfit_t, FMFTS_AXES)                                                                                 \
    MANY(double, ambient_t, 3)                                                                                         \
    MANY(double, shear_n, 2 * FMFTS_TOLD_FINGERS)                                                                      \
    MANY(double, shear_deviation_n, 2 * FMFTS_TOLD_FINGERS)                                                            \
    MANY(double, noise_t, FMFTS_AXES)                                                                                  \
    MANY(double, slope_t, FMFTS_AXES * FMFTS_FINGER_NUMBERS * FMFTS_TOLD_FINGERS)                                      \
    MANY(double, least, FMFTS_FINGER_NUMBERS * (1 + FMFTS_TOLD_FINGERS))

FMFTS_STRUCT(fmfts_calm_room, FMFTS_CALM_ROOM)

/* What a calm frame is judged with: views of Python's arrays. rest: of fmfts_samples_of. untouched: position, axis [magnets][3] and
 * variance [magnets][5] of the magnets at rest, and by how much [values] a sample must change until a finger is looked for in it. */
typedef struct {
    const fmfts_several_steps *steps;
    fmfts_several model;
    fmfts_search search;
    fmfts_several_work *work;
    const fmfts_ordinary_limits *limits;
    const double *rest, *untouched;
    const fmfts_mounted_parameters *mounted;
    fmfts_followed_memory *followed;
    fmfts_calm_room *room;
} fmfts_calm;

/* fingers.c: the fields of a message without an estimate, of a pad with several magnets. `several`: where it has its own. */
void fmfts_tell_nothing(fmfts_told_several *several, fmfts_reading *reading);

/* fingers.c: the contact, and each finger. over_range: they are beyond the table. */
void fmfts_tell_fingers(const fmfts_mounted_parameters *mounted, const fmfts_fingers_found *found, bool over_range,
                        fmfts_told_several *several, fmfts_reading *reading);

/* fingers.c: the poses of `axes` / 3 sensors' field. */
void fmfts_tell_magnets(const fmfts_mounted_parameters *mounted, const fmfts_magnets_found *found, size_t axes,
                        fmfts_told_several *several, fmfts_reading *reading);

#endif
