/* A healthy frame, from counts to pose: alignment.c, tracker.c, mean_residuals.c and change.c. The Python file of the same name
 * explains each step, and is its oracle.
 *
 * If a frame is not healthy in every respect, but for what `silent`, `saturated` and `blamed` name, these
 * functions return false, and Python judges the frame. Re-entrant: no
 * allocation, no globals. SI units unless a name says otherwise. Arrays are row-major.
 */
#ifndef FMFTS_POSE_STEP_H
#define FMFTS_POSE_STEP_H

#include <stdbool.h>
#include <stdint.h>

#include "../common/double_table.h"
#include "../sensor/reading.h"
#include "problem.h"

enum {
    FMFTS_AXES = 3 * FMFTS_SENSORS,
    FMFTS_STATE = FMFTS_VALUES(1),
    FMFTS_STEP = FMFTS_COLUMNS(1),
    FMFTS_LEFTOVERS = 25,                           /* causes of errors of a change of pose: baseline/unknowns.py */
    FMFTS_FIELD_ERRORS = 9 + 12 * FMFTS_SENSORS + 1, /* unknowns that a baseline may leave, and the cylinder: the same */
    FMFTS_DECADES = 4, /* of time, in which silicone creeps: silicone.py */
    FMFTS_CHANGE = 8, /* pose 5 and ambient field 3, since the baseline */
    FMFTS_NEIGHBOURS = 4, /* pads with one magnet that are felt; of more, Python judges */
    FMFTS_PLACED = 7, FMFTS_MOVES = 6, /* the values and the columns of a neighbour's magnet: state.py */
};

/* What these steps need of a pad, its baseline and its scene. */
#define FMFTS_POSE_PARAMETERS(X)                                                                                       \
    X(sensors, 1)                                                                                                      \
    X(saturated_count, 1)       /* sensor/chips/ */                                                                    \
    X(step_t, 3 * FMFTS_GAIN_CODES)                                                                                    \
    X(at_zero_c, 1)             /* NaN: no thermometer */                                                              \
    X(c_per_count, 1)                                                                                                  \
    X(range_c, 2)                                                                                                      \
    X(largest_count, 1)                                                                                                \
    X(stopped_us, 1)            /* alignment.py */                                                                     \
    X(longest_gap_us, 1)                                                                                               \
    X(jump_t, 1)                                                                                                       \
    X(repeats_allowed, FMFTS_AXES)                                                                                     \
    X(gain, FMFTS_AXES)         /* mounting.py */                                                                      \
    X(offset_t, FMFTS_AXES)                                                                                            \
    X(rest_field_t, FMFTS_AXES)                                                                                        \
    X(sensitivity_deviation, 3 * FMFTS_AXES)                                                                           \
    X(place_deviation, FMFTS_SENSORS)                                                                                  \
    X(systematic_t, 1)                                                                                                 \
    X(offset_t_per_k, 1)                                                                                               \
    X(noise_t, FMFTS_AXES)                                                                                             \
    X(place_m, FMFTS_AXES)                                                                                             \
    X(direction, 3 * FMFTS_AXES)                                                                                       \
    X(strength_t_m3, 1)                                                                                                \
    X(octupole_m2, 1)                                                                                                  \
    X(part, FMFTS_STEP)         /* tracking_model.py */                                                                \
    X(walk_per_s, FMFTS_STEP)                                                                                          \
    X(moment_per_k, 1)                                                                                                 \
    X(moment_per_k_deviation, 1)                                                                                       \
    X(rest_temperature_c, 1)    /* NaN: unknown */                                                                     \
    X(rest, FMFTS_STATE)                                                                                               \
    X(stop_chi2, 1)             /* tracker.py */                                                                       \
    X(max_iterations, 1)                                                                                               \
    X(reach_m, 1)               /* gate.py */                                                                          \
    X(log_moment_reach, 1)                                                                                             \
    X(strongest, 1)                                                                                                    \
    X(vague_m, 1)                                                                                                      \
    X(gate_chi2, FMFTS_AXES + 1) /* by degrees of freedom; NaN: none */                                                \
    X(unknowns, 1)                                                                                                     \
    X(misfit_frames, 1)         /* tracker.py */                                                                       \
    X(memory_frames, 1)         /* mean_residuals.py */                                                                    \
    X(judged_every, 1)                                                                                                 \
    X(alarm_chi2, FMFTS_AXES + 1) /* by degrees of freedom */                                                          \
    X(sound_chi2, FMFTS_AXES + 1)                                                                                      \
    X(field_errors, 1)          /* field_errors.py: how many */                                                        \
    X(by_pose, 5 * FMFTS_AXES * FMFTS_FIELD_ERRORS)                                                                    \
    X(by_field, 3 * FMFTS_AXES * FMFTS_FIELD_ERRORS)                                                                   \
    X(leftovers, 1)                                                                                                    \
    X(change_error, 5 * FMFTS_CHANGE * FMFTS_LEFTOVERS)                                                                \
    X(silicone_share, 1)        /* silicone.py */                                                                      \
    X(creep_share, 1)                                                                                                  \
    X(unseen_gap_s, 1)                                                                                                 \
    X(creep_time_s, FMFTS_DECADES)                                                                                     \
    X(reference_t, 3)           /* hidden_gradient.py; NaN: not known */                                               \
    X(reference_strength_t, 1)                                                                                         \
    X(iron_t, 1)                                                                                                       \
    X(even_t, 1)                                                                                                       \
    X(healthy_deviations, 1)                                                                                           \
    X(fades_s, 1)                                                                                                      \
    X(strongest_foreign_t, 1)                                                                                          \
    X(ambient_errors, 1)                                                                                               \
    X(ambient_error, 3 * FMFTS_CHANGE * FMFTS_LEFTOVERS)                                                               \
    X(unit_gradient, 25)                                                                                               \
    X(neighbours, 1)            /* neighbour.py: how many */                                                           \
    X(neighbour_turn, 9 * FMFTS_NEIGHBOURS)   /* from their axes to the pad's */                                       \
    X(neighbour_place_m, 3 * FMFTS_NEIGHBOURS)                                                                         \
    X(neighbour_placement_m, FMFTS_NEIGHBOURS) /* the deviation of that */                                             \
    X(neighbour_magnet, FMFTS_MAGNET * FMFTS_NEIGHBOURS)                                                               \
    X(speed_m_per_s, 1)                                                                                                \
    X(turn_rad_per_s, 1)                                                                                               \
    X(farthest_m, 1)                                                                                                   \
    X(farthest_rad, 1)                                                                                                 \
    X(moment_deviation, 1)                                                                                             \
    X(drawn_rest_m, 3)          /* change.py */                                                                        \
    X(drawn_turn, 9)

/* What one frame leaves to the next. Arrays over sensors hold only the pad's sensors, one after the other. */
#define FMFTS_POSE_MEMORY(X)                                                                                           \
    X(field_t, 3 * FMFTS_AXES)  /* three newest samples [3][sensors][3] */                                             \
    X(time_us, 3 * FMFTS_SENSORS)                                                                                      \
    X(repeats, FMFTS_AXES)                                                                                             \
    X(last_us, 1)                                                                                                      \
    X(state, FMFTS_STATE)                                                                                              \
    X(covariance, FMFTS_STEP * FMFTS_STEP)                                                                             \
    X(warmth_variance, 1)                                                                                              \
    X(warmed_k, 1)              /* Estimator: since rest, by the last temperature */                                   \
    X(misfit, 1)                                                                                                       \
    X(mean_t, FMFTS_AXES)       /* of the residuals */                                                                 \
    X(lasting_t2, FMFTS_AXES)                                                                                          \
    X(frames, FMFTS_AXES)                                                                                              \
    X(change, FMFTS_CHANGE)                                                                                            \
    X(pushed, 1)                                                                                                       \
    X(since, 1)                                                                                                        \
    X(sound, 1)                                                                                                        \
    X(was_sound, 1)             /* at any judgement since Python handed the memory over */                             \
    X(lasting_misfit, 1)                                                                                               \
    X(recent_t, FMFTS_AXES)     /* mean of the residuals since the last judgement */                                   \
    X(recent, 1)                                                                                                       \
    X(crept, 5 * FMFTS_DECADES)                                                                                        \
    X(pressed, 5)                                                                                                      \
    X(foreign_t, 1)                                                                                                    \
    X(passed, 1)                /* frames since Python handed the memory over */                                        \
    X(silent, 1)                /* sensors that every frame since then lacks, as a mask; path.py */                     \
    X(saturated, FMFTS_AXES)    /* axes that are saturated in every frame since then */                                 \
    X(gain_code, 1)             /* that all of them have; negative: any, and nothing is missing */                      \
    X(blamed, 1)                /* the sensor that is left out, as it contradicts the others; negative: none */          \
    X(most, 1)                  /* so many frames may pass before Python looks again */

FMFTS_STRUCT(fmfts_pose_parameters, FMFTS_POSE_PARAMETERS)
FMFTS_STRUCT(fmfts_pose_memory, FMFTS_POSE_MEMORY)

/* Where a pad's magnet was last seen, in that pad's axes: sighting.py. time_ns: on the host's clock; NaN: never. */
#define FMFTS_SIGHTING(X)                                                                                              \
    X(last, FMFTS_PLACED)                                                                                              \
    X(covariance, FMFTS_MOVES * FMFTS_MOVES)                                                                           \
    X(time_ns, 1)                                                                                                      \
    X(rest, FMFTS_PLACED)                                                                                              \
    X(rest_error, 2)

FMFTS_STRUCT(fmfts_sighting, FMFTS_SIGHTING)

/* The neighbours at one instant, in this pad's axes: NeighbourEstimate of neighbour.py. */
typedef struct {
    size_t count;
    double magnet[FMFTS_NEIGHBOURS][FMFTS_MAGNET];
    double rest[FMFTS_NEIGHBOURS][FMFTS_PLACED], now[FMFTS_NEIGHBOURS][FMFTS_PLACED];
    double covariance[FMFTS_NEIGHBOURS][FMFTS_MOVES][FMFTS_MOVES];
    double rest_error[FMFTS_NEIGHBOURS][2], placement_m[FMFTS_NEIGHBOURS];
} fmfts_felt;

/* The Earth's field at the baseline, and its strength: Reference of hidden_gradient.py. */
typedef struct {
    double field_t[3], strength_t;
} fmfts_reference;

/* One raw frame. readings: per sensor x, y, z and age in µs, little-endian, as in docs/wire.md. */
typedef struct {
    const uint8_t *readings;
    double time_us;
    double sequence;
    double temperature_c; /* NaN: unknown */
    int64_t host_ns;      /* the host's time of time_us */
    unsigned gain_code, valid, fresh;
} fmfts_frame;

/* The field (T, sensor axes) at one instant, and the variance of its errors: alignment.py, mounting.py. */
typedef struct {
    double instant_us;
    double field_t[FMFTS_AXES];
    double lasting_t2[FMFTS_AXES]; /* part of variance_t2: from curvature, which averaging does not reduce */
    double unknown_t2[FMFTS_AXES]; /* part of variance_t2: from what the baseline leaves unknown */
    double other_t2[FMFTS_AXES];   /* part of variance_t2: from warming and neighbours, which averaging does not reduce, either */
    double variance_t2[FMFTS_AXES];
} fmfts_field;

typedef struct {
    double covariance[FMFTS_STEP * FMFTS_STEP]; /* widened by the recent misfit */
    double chi2, residual_t;
    double elapsed_s; /* since the frame before */
} fmfts_pose;

/* change: of pose from rest, position and axis in the rest axis's tangent plane. basis: the estimate's tangents. turn: from
 * the estimate's tangents to those at rest. */
typedef struct {
    double change[5];
    double covariance[5][5]; /* over position and the estimate's tangents, with what mounting leaves unknown */
    double at_rest[25];      /* the covariance [5][5] of `change` */
    double basis[2][3];
    double turn[2][2];
} fmfts_displacement;

/* alignment.c: the frame's field, baseline subtracted, at one instant. */
bool fmfts_align(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_frame *frame,
                 fmfts_field *field);

/* alignment.c: whether an axis has a sample of which it is not known when its field changed; after fmfts_align. */
bool fmfts_has_jumped(const fmfts_pose_parameters *parameters, const fmfts_field *field);

/* alignment.c: the variance of what the baseline leaves unknown of an axis, at a change [3] of its sensor's field from rest:
 * Mounting.lasting_deviation_t, squared. */
double fmfts_lasting_variance(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, int axis,
                              const double change[3]);

/* neighbour.c: the neighbours at `time_ns` (host's clock), from where they were last seen: NeighbourView.at. */
void fmfts_feel(const fmfts_pose_parameters *parameters, const fmfts_sighting *const *seen, double time_ns, fmfts_felt *felt);

/* neighbour.c: adds the field of the neighbours at rest, which the baseline has subtracted, and the variance of their places:
 * with_rest and placement_deviation. */
void fmfts_add_neighbours(const fmfts_pose_parameters *parameters, const fmfts_felt *felt, fmfts_field *field);

/* neighbour.c: subtracts the field of the neighbours at `placed`, as they were solved: without_neighbours. */
void fmfts_take_neighbours(const fmfts_pose_parameters *parameters, const fmfts_felt *felt, const double placed[][FMFTS_PLACED],
                           fmfts_field *field);

/* neighbour.c: HiddenGradient._reference_t. */
fmfts_reference fmfts_reference_beside(const fmfts_pose_parameters *parameters, const fmfts_felt *felt);

/* tracker.c: solves for the magnet's state, from the field and the state before, into `memory`; and takes the neighbours' field
 * away. */
bool fmfts_track(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_felt *felt, fmfts_field *field,
                 double temperature_c, fmfts_pose *pose);

/* mean_residuals.c: adds the residuals to their mean. False if the mean is not that of healthy sensors. slopes [axes]:
 * receives the derivatives of the prediction by a step of the memory's state. */
bool fmfts_judge_residuals(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_field *field,
                           double slopes[][FMFTS_STEP]);

/* overlap.c: the part of the memory's covariance of the pose that the baseline's leftovers count, too. slopes: of
 * fmfts_judge_residuals. */
void fmfts_overlap(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const fmfts_field *field,
                   const double slopes[][FMFTS_STEP], double overlap[5][5]);

/* change.c: the change [5] of pose since rest. */
void fmfts_change(const fmfts_pose_parameters *parameters, const double *state, double change[5]);

/* change.c: the same, and its covariance. memory: of the loads that the silicone has borne. overlap: the part of the pose's
 * covariance that the leftovers count, too; NULL: nothing. */
void fmfts_displace(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double *state,
                    const fmfts_pose *pose, const double overlap[5][5], fmfts_displacement *d);

/* change.c: how far (m) the change moved the magnet's centre, and the deviation along that direction: distance of change.py. */
void fmfts_distance(const fmfts_displacement *d, double *moved_m, double *deviation_m);

/* silicone.c: notes in `memory` the load of its state. elapsed_s: since the last frame. */
void fmfts_follow_creep(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, double elapsed_s);

/* silicone.c: adds to `covariance` what silicone leaves uncertain of the change of pose. */
void fmfts_creep(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double change[5],
                 double covariance[5][5]);

/* change.c: adds to the covariance of `state`'s pose that of a change of pose, over the rest axis's tangents. */
void fmfts_widen(const fmfts_pose_parameters *parameters, const double *state, const double added[5][5], fmfts_pose *pose);

/* hidden_gradient.c: notes in `memory` the foreign field that the ambient field shows, and adds to the pose's covariance
 * what it leaves uncertain. False if it is too strong. */
bool fmfts_follow_foreign(const fmfts_pose_parameters *parameters, const fmfts_reference *reference, fmfts_pose_memory *memory,
                          fmfts_pose *pose);

/* hidden_gradient.c: the same addition, to the covariance of another `state`. */
void fmfts_widen_by_foreign(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double *state,
                            fmfts_pose *pose);

/* change.c: in_nominal_frame. pose [6]: position (× unit_per_m) and axis; covariance [6][6]. */
void fmfts_draw(const fmfts_pose_parameters *parameters, const double *state, const fmfts_displacement *d,
                double unit_per_m, double pose[6], double covariance[36]);

#endif
