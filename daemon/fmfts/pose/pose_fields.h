/* What the steps of step.h need of a pad, and what one frame leaves to the next. */
#ifndef FMFTS_POSE_FIELDS_H
#define FMFTS_POSE_FIELDS_H

#include "../common/fields.h"
#include "../sensor/reading.h"
#include "problem.h"

enum {
    FMFTS_AXES = 3 * FMFTS_SENSORS,
    FMFTS_STATE = FMFTS_VALUES(1),
    FMFTS_STEP = FMFTS_COLUMNS(1),
    FMFTS_LEFTOVERS = 25,                           /* causes of errors of a change of pose: baseline/unknowns.py */
    FMFTS_DECADES = 4, /* of time, in which silicone creeps: silicone.py */
    FMFTS_CHANGE = 8, /* pose 5 and ambient field 3, since the baseline */
    FMFTS_FELT = FMFTS_MAX_MAGNETS - 1, /* magnets of neighbouring pads that are felt */
    FMFTS_FEWEST_SENSORS = 3, /* with fewer complete ones, wrong poses fit as well as the true one */
    FMFTS_RING = 64, /* frames in which alternating.c looks for a line */
    FMFTS_PLACED = 7, FMFTS_MOVES = 6, /* the values and the columns of a neighbour's magnet: state.py */
};

/* What these steps need of a pad, its baseline and its scene. */
#define FMFTS_POSE_PARAMETERS(ONE, MANY)                                                                                       \
    ONE(double, sensors)                                                                                               \
    ONE(double, saturated_count) /* sensor/chips/ */                                                                   \
    MANY(double, step_t, 3 * FMFTS_GAIN_CODES)                                                                         \
    ONE(double, at_zero_c) /* NaN: no thermometer */                                                                   \
    ONE(double, c_per_count)                                                                                           \
    MANY(double, range_c, 2)                                                                                           \
    ONE(double, largest_count)                                                                                         \
    ONE(double, period_us) /* of the board's frames */                                                                 \
    MANY(double, repeats_allowed, FMFTS_AXES)                                                                          \
    MANY(double, gain, FMFTS_AXES) /* mounting.py */                                                                   \
    MANY(double, offset_t, FMFTS_AXES)                                                                                 \
    MANY(double, rest_field_t, FMFTS_AXES)                                                                             \
    MANY(double, sensitivity_deviation, 3 * FMFTS_AXES)                                                                \
    MANY(double, place_deviation, FMFTS_SENSORS)                                                                       \
    ONE(double, systematic_t)                                                                                          \
    ONE(double, offset_t_per_k)                                                                                        \
    MANY(double, noise_t, FMFTS_AXES)                                                                                  \
    MANY(double, place_m, FMFTS_AXES)                                                                                  \
    MANY(double, direction, 3 * FMFTS_AXES)                                                                            \
    ONE(double, strength_t_m3)                                                                                         \
    ONE(double, octupole_m2)                                                                                           \
    MANY(double, part, FMFTS_STEP) /* tracking_model.py */                                                             \
    MANY(double, walk_per_s, FMFTS_STEP)                                                                               \
    ONE(double, moment_per_k)                                                                                          \
    ONE(double, moment_per_k_deviation)                                                                                \
    ONE(double, rest_temperature_c) /* NaN: unknown */                                                                 \
    MANY(double, rest, FMFTS_STATE)                                                                                    \
    MANY(double, gate_chi2, FMFTS_AXES + 1) /* gate.c: by degrees of freedom; NaN: no gate */                          \
    MANY(double, motion_chi2, FMFTS_AXES + 1) /* ambient_motion.c */                                                   \
    MANY(double, surprising_chi2, FMFTS_AXES + 1) /* alternating.c: by degrees of freedom */                           \
    ONE(double, line_chi2)                                                                                             \
    ONE(double, at_rest) /* 0 if only the bare board was recorded, without the pad */                                  \
    ONE(double, steel_nearby) /* the scene says that steel or magnets pass */                                          \
    ONE(double, unread_warming_k)                                                                                      \
    MANY(double, alarm_chi2, FMFTS_AXES + 1) /* mean_residuals.c: by degrees of freedom */                             \
    MANY(double, sound_chi2, FMFTS_AXES + 1)                                                                           \
    ONE(double, leftovers)                                                                                             \
    MANY(double, change_error, 5 * FMFTS_CHANGE * FMFTS_LEFTOVERS)                                                     \
    ONE(double, silicone_share) /* silicone.py */                                                                      \
    ONE(double, creep_share)                                                                                           \
    ONE(double, unseen_gap_s)                                                                                          \
    MANY(double, creep_time_s, FMFTS_DECADES)                                                                          \
    MANY(double, reference_t, 3) /* hidden_gradient.py; NaN: not known */                                              \
    ONE(double, reference_strength_t)                                                                                  \
    ONE(double, iron_t)                                                                                                \
    ONE(double, even_t)                                                                                                \
    ONE(double, healthy_deviations)                                                                                    \
    ONE(double, strongest_foreign_t)                                                                                   \
    ONE(double, ambient_errors)                                                                                        \
    MANY(double, ambient_error, 3 * FMFTS_CHANGE * FMFTS_LEFTOVERS)                                                    \
    MANY(double, unit_gradient, 25)                                                                                    \
    ONE(double, neighbours) /* neighbour.c: how many pads */                                                           \
    MANY(double, neighbour_magnets, FMFTS_FELT) /* how many each has */                                                \
    MANY(double, neighbour_turn, 9 * FMFTS_FELT) /* from their axes to the pad's */                                    \
    MANY(double, neighbour_place_m, 3 * FMFTS_FELT)                                                                    \
    MANY(double, neighbour_placement_m, FMFTS_FELT) /* the deviation of that */                                        \
    MANY(double, neighbour_magnet, FMFTS_MAGNET * FMFTS_FELT) /* one after the other */                                \
    MANY(double, drawn_rest_m, 3) /* change.py */                                                                      \
    MANY(double, drawn_turn, 9)                                                                                        \
    MANY(double, pad_turn, 9)

/* The cause of the last unexplained frame: no search; one of several sensors is faulty; no pose of this magnet; a
 * foreign field; one sensor is faulty, or the field has turned; offsets may have drifted too far for a pose. */
typedef enum {
    FMFTS_NOT_SEARCHED, FMFTS_SENSOR_AT_FAULT, FMFTS_NO_POSE, FMFTS_NOT_ALONE, FMFTS_NOT_CONFIRMED, FMFTS_DRIFTED
} fmfts_cause;

/* What one frame leaves to the next. Arrays over sensors hold only the pad's sensors, one after the other. A mask has bit i
 * for sensor i. */
#define FMFTS_POSE_MEMORY(ONE, MANY)                                                                                   \
    MANY(double, field_t, 3 * FMFTS_AXES) /* push.h: the three newest samples [3][sensors][3] */                       \
    MANY(int64_t, time_us, 3 * FMFTS_SENSORS)                                                                          \
    MANY(int64_t, repeats, FMFTS_AXES)                                                                                 \
    ONE(int64_t, without_news)                                                                                         \
    ONE(int64_t, newest_us) /* alignment.c: of the newest sample, on its clock */                                      \
    ONE(int64_t, leapt_us) /* how far the board's clock has leapt since that sample */                                 \
    ONE(int64_t, frame_us) /* the last frame's time on the board's clock, on the host's, and its number */   \
    ONE(int64_t, frame_ns)                                                                                             \
    ONE(int64_t, sequence)                                                                                             \
    ONE(int64_t, stood_ns) /* host's time and number of the first frame with that time on the board's clock, which may stand */\
    ONE(int64_t, stood_sequence)                                                                                       \
    ONE(double, last_us) /* the last frame's instant; NaN before the first */                                          \
    ONE(double, lifted_s) /* contact_of_pose.c: how long the magnet has been above its rest */                          \
    ONE(double, rested_s) /* how long it has been at rest since */                                                     \
    ONE(double, unread_s) /* how long the last temperature has been held */                                            \
    ONE(double, warmed_k) /* since rest, by the last temperature */                                                    \
    ONE(double, further_drift) /* mean_residuals.c: T²/K²; variance of the offsets' drift that the model lacks */      \
    ONE(int64_t, calm_drift) /* how many means in a row a smaller drift has explained */                               \
    MANY(double, state, FMFTS_STATE) /* tracker.c: of the last good frame */                                           \
    MANY(double, covariance, FMFTS_STEP * FMFTS_STEP)                                                                  \
    ONE(double, since_good_s)                                                                                          \
    ONE(int64_t, native_frames) /* with the Earth's field alone, as far as is known; at most FMFTS_TRUSTED_FRAMES */    \
    ONE(double, unread_variance) /* variance of the log moment through the unknown temperature, until one is read */   \
    ONE(double, warmth_variance) /* the largest variance that warming has added */                                     \
    ONE(double, misfit) /* recent mean of chi2 per degree of freedom */                                                \
    ONE(int64_t, disturbed_frames) /* how many frames no pose explained since then */                                  \
    ONE(int64_t, searched) /* fmfts_cause: what the last search for the cause found */                                 \
    ONE(int64_t, searched_sensors) /* mask: the suspects */                                                            \
    MANY(double, mean_t, FMFTS_AXES) /* mean_residuals.c: of the residuals */                                          \
    MANY(double, lasting_t2, FMFTS_AXES)                                                                               \
    MANY(double, frames, FMFTS_AXES)                                                                                   \
    MANY(double, change, FMFTS_CHANGE)                                                                                 \
    ONE(double, pushed)                                                                                                \
    ONE(double, since)                                                                                                 \
    ONE(int64_t, sound)                                                                                                \
    ONE(double, lasting_misfit)                                                                                        \
    MANY(double, recent_t, FMFTS_AXES) /* mean of the residuals since the last judgement */                            \
    ONE(double, recent)                                                                                                \
    ONE(int64_t, found) /* residual_monitor.c: something is wrong */                                                   \
    ONE(int64_t, found_sensor) /* the faulty sensor; negative: none alone */                                           \
    ONE(int64_t, found_foreign) /* a foreign field explains it better */                                               \
    ONE(int64_t, suspects) /* mask */                                                                                  \
    ONE(int64_t, heard) /* mask: sensors that single frames blamed since the last healthy mean */                              \
    MANY(double, lowest_t, 3) /* ambient_motion.c: range of the ambient field in the frames that it explained */       \
    MANY(double, highest_t, 3)                                                                                         \
    ONE(int64_t, explained) /* bit i: whether it explained the i-th last frame that was looked at */                   \
    ONE(double, moved_t) /* by how much the field moved */                                                             \
    ONE(int64_t, frames_seen)                                                                                          \
    ONE(int64_t, well_frames)                                                                                          \
    MANY(double, crept, 5 * FMFTS_DECADES) /* silicone.c */                                                            \
    MANY(double, pressed, 5)                                                                                           \
    ONE(double, unseen_s) /* since the last frame with a pose that can be trusted, before this frame */                \
    ONE(double, foreign_t) /* hidden_gradient.c */                                                                     \
    ONE(double, steady_frames) /* steady_moment.c: of the log moment of recent frames: how many, mean and variance */  \
    ONE(double, steady_moment)                                                                                         \
    ONE(double, steady_variance)                                                                                       \
    ONE(int64_t, alternates) /* alternating.c: whether the ambient field is solved for as an alternating one */        \
    ONE(double, alternating_t2) /* the variance that the alternating field adds to each axis */                        \
    ONE(int64_t, calm_frames) /* since that variance rose */                                                           \
    MANY(double, last_surprise, FMFTS_AXES + 1)                                                                        \
    ONE(double, surprises) /* sum of recent outliers that alternate in direction */                                    \
    MANY(int64_t, blamed, FMFTS_SENSORS) /* frames until it is forgotten that a single frame blamed the sensor */      \
    MANY(double, last_ambient_t, 3)                                                                                    \
    MANY(double, ring_t, 3 * FMFTS_RING) /* spectrum.c: the ambient field of recent frames */                          \
    ONE(int64_t, ring_frames)                                                                                          \
    ONE(int64_t, quiet_rings) /* number of spectra since a line or much noise was found */                             \
    ONE(double, line_hz) /* as sampled; 0: none */                                                                     \
    ONE(double, line_t)

FMFTS_STRUCT(fmfts_pose_parameters, FMFTS_POSE_PARAMETERS)
FMFTS_STRUCT(fmfts_pose_memory, FMFTS_POSE_MEMORY)

#endif
