/* The pose and its rate at the newest sample, from each chip's samples at their own times: motion.c explains it. */
#ifndef FMFTS_MOTION_H
#define FMFTS_MOTION_H

#include "step.h"

enum { FMFTS_MOTION_STATES = 13, FMFTS_MODES = 2, FMFTS_RATE = 5, FMFTS_AMBIENT_CHANGE = 10 };

/* weights: 0 excludes a mode: `bench now --ablation` shows the benefit of each. surprise_chi2: frames with larger
 * innovations are not those of a healthy pad; early_chi2: the same of a sample that came before its frame. */
#define FMFTS_MOTION_PARAMETERS(ONE, MANY)                                                                                     \
    MANY(double, weights, FMFTS_MODES)                                                                                 \
    ONE(double, surprise_chi2)                                                                                         \
    ONE(double, early_chi2)

/* early_…: of samples that came before their frame, since the last frame. */
#define FMFTS_MOTION_MEMORY(ONE, MANY)                                                                                         \
    ONE(double, motion_us) /* time of the newest sample on the board's clock; 0 while the filter does not run */       \
    MANY(double, motion_state, FMFTS_MOTION_STATES) /* merged */                                                       \
    MANY(double, motion_covariance, FMFTS_MOTION_STATES * FMFTS_MOTION_STATES)                                         \
    MANY(double, modes, FMFTS_MODES) /* probabilities */                                                               \
    ONE(double, followed) /* frames since the filter began */                                                          \
    MANY(double, early_us, FMFTS_SENSORS) /* time of each sensor's newest sample; 0 before the first */                \
    ONE(double, early_from_us) /* motion_us, and the modes, after the last frame */                                    \
    MANY(double, early_modes, FMFTS_MODES)                                                                             \
    MANY(double, early_state, FMFTS_MODES * FMFTS_MOTION_STATES) /* for each mode, as are the next fields */           \
    MANY(double, early_covariance, FMFTS_MODES * FMFTS_MOTION_STATES * FMFTS_MOTION_STATES)                            \
    MANY(double, early_chi2_sum, FMFTS_MODES)                                                                          \
    MANY(double, early_widths, FMFTS_MODES)

FMFTS_STRUCT(fmfts_motion_parameters, FMFTS_MOTION_PARAMETERS)
FMFTS_STRUCT(fmfts_motion_memory, FMFTS_MOTION_MEMORY)

/* One sensor's sample that came before its frame. field_t: as measured; NaN where an axis holds no measurement. */
typedef struct {
    int sensor;
    int64_t time_us;
    double field_t[3];
} fmfts_early;

/* Stops the filter. It does not run until it begins. */
void fmfts_forget_motion(fmfts_motion_memory *memory);

enum { FMFTS_FOLLOWED = 8 }; /* states that samples depend on: the pose's change, or a finger in its place, and the ambient field */

/* The input of the filter: the pad, its newest samples, W [5][5] of motion.c, and what the samples depend on. */
typedef struct fmfts_driven {
    const fmfts_pose_parameters *parameters;
    const fmfts_pose_memory *pose;
    const double *drive;
    /* The prediction for the axes of a sensor in state x, baseline subtracted, and its derivatives. */
    void (*look)(const struct fmfts_driven *driven, int sensor, const double *x, double ahead[3], double slope[3][FMFTS_FOLLOWED]);
    double strength;   /* of a magnet */
    const void *finger; /* for a pad with several magnets: pipeline/finger.h */
} fmfts_driven;

/* motion_modes.c: predicts one magnet, whose moment is that of the pad's last pose. */
fmfts_driven fmfts_driven_magnet(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *pose, const double *drive);

/* Begins at time_us, with known [8] and its covariance [8][8]; the drive alone bounds the rates. */
void fmfts_begin_states(double time_us, const double *known, const double *covariance, const double *drive,
                        fmfts_motion_memory *memory);

/* Begins with the frame's pose at its instant. drive [5][5]: as above. */
void fmfts_begin_motion(const fmfts_step *step, const double *drive, fmfts_motion_memory *memory);

/* Takes the fresh samples of `driven->pose` (bit i of `fresh`: sensor i), except those that came before their frame. Stops the
 * filter and returns False if they contradict the prediction. */
bool fmfts_follow(const fmfts_driven *driven, const fmfts_motion_parameters *own, unsigned fresh, fmfts_motion_memory *memory);

/* Whether a sample that came before its frame goes on from those that the filter took. */
bool fmfts_is_next(const fmfts_motion_memory *memory, int sensor, double time_us);

/* Takes the next sample of one sensor, which came before its frame. Otherwise like fmfts_follow. */
bool fmfts_follow_early(const fmfts_driven *driven, const fmfts_motion_parameters *own, const fmfts_early *early,
                        fmfts_motion_memory *memory);

/* The pose after a change [5] from rest. turn: derivative of the axis by the tilt. */
void fmfts_pose_after(const fmfts_pose_parameters *parameters, const double *change, double position[3], double axis[3],
                      double turn[2][3]);

#endif
