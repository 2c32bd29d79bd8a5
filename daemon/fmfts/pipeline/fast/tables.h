/* A healthy frame, from counts to contact: the equations of pad_pipeline.py and its stages, without Python.
 *
 * The Python stages explain every step and are the oracle of these files. Where a frame is not healthy in every respect,
 * the functions here return false and the pad's memory stays what it was: the stages in Python judge such a frame.
 * Re-entrant: no allocation, no globals. SI units unless a name says otherwise. Arrays are row-major.
 */
#ifndef FMFTS_HEALTHY_H
#define FMFTS_HEALTHY_H

#include <stdbool.h>
#include <stdint.h>

#include "../../contact/refine.h"
#include "../../pose/solver.h"
#include "../../sensor/wire/sample.h"

enum {
    FMFTS_SENSORS = FMFTS_WIRE_SENSORS,
    FMFTS_AXES = 3 * FMFTS_SENSORS,
    FMFTS_STATE = FMFTS_VALUES(1),
    FMFTS_STEP = FMFTS_COLUMNS(1),
    FMFTS_LEFTOVERS = 9 + 6 * FMFTS_SENSORS, /* what a mounting may leave open: baseline/unknowns.py */
    FMFTS_FIELD_ERRORS = FMFTS_LEFTOVERS + 1,
    FMFTS_CHANGE = 8, /* of pose 5 and ambient field 3 since the baseline */
    FMFTS_BINS = 16,
};

/* Each table names the doubles of a struct, in order: Python reads the names and fills or views them (path.py). Arrays
 * over sensors hold those of the pad one after the other; what is left of them stays empty. */

/* What a pad, its baseline, scene and contact model are. */
#define FMFTS_FACTS(X)                                                                                                 \
    X(sensors, 1)                                                                                                      \
    X(saturated_count, 1)       /* chip.py */                                                                          \
    X(step_t, 3 * FMFTS_GAIN_CODES)                                                                                    \
    X(at_zero_c, 1)             /* NaN: no thermometer */                                                              \
    X(c_per_count, 1)                                                                                                  \
    X(stopped_us, 1)            /* alignment.py */                                                                     \
    X(jump_t, 1)                                                                                                       \
    X(repeats_allowed, FMFTS_AXES)                                                                                     \
    X(gain, FMFTS_AXES)         /* mounting.py */                                                                      \
    X(offset_t, FMFTS_AXES)                                                                                            \
    X(rest_field_t, FMFTS_AXES)                                                                                        \
    X(gain_deviation, FMFTS_AXES)                                                                                      \
    X(place_deviation, FMFTS_SENSORS)                                                                                  \
    X(systematic_t, 1)                                                                                                 \
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
    X(reach_m, 1)                                                                                                      \
    X(log_moment_reach, 1)                                                                                             \
    X(vague_m, 1)                                                                                                      \
    X(gate_chi2, 1)                                                                                                    \
    X(freedom, 1)                                                                                                      \
    X(misfit_frames, 1)                                                                                                \
    X(memory_frames, 1)         /* innovation.py */                                                                    \
    X(judged_every, 1)                                                                                                 \
    X(alarm_chi2, 1)                                                                                                   \
    X(sound_chi2, 1)                                                                                                   \
    X(field_errors, 1)          /* field_errors.py: how many */                                                        \
    X(by_pose, 5 * FMFTS_AXES * FMFTS_FIELD_ERRORS)                                                                    \
    X(by_field, FMFTS_AXES * FMFTS_FIELD_ERRORS)                                                                       \
    X(leftovers, 1)                                                                                                    \
    X(change_error, 25 * FMFTS_LEFTOVERS)                                                                              \
    X(onset_chi2, 1)            /* touch.py */                                                                         \
    X(release_chi2, 1)                                                                                                 \
    X(release_frames, 1)                                                                                               \
    X(longest_gap_s, 1)                                                                                                \
    X(drawn_rest_m, 3)          /* change.py */                                                                        \
    X(drawn_turn, 9)                                                                                                   \
    X(refine_steps, 1)          /* refinement.py: of a model that refines */                                           \
    X(least_variance, 1)        /* of each component that it refines with */                                           \
    X(model_rest, 6)            /* contact/model.py, in its units: mm, and numbers of the axis */                      \
    X(lowest, 6)                                                                                                       \
    X(highest, 6)                                                                                                      \
    X(outside_deviations, 1)                                                                                           \
    X(certain_deviations, 1)                                                                                           \
    X(certain_force_deviations, 1)                                                                                     \
    X(trained_top_mm, 1)                                                                                               \
    X(lifted_above_mm, 1)                                                                                              \
    X(lifted_deviations, 1)                                                                                            \
    X(force_max_n, 1)                                                                                                  \
    X(unfelt_n, 1)                                                                                                     \
    X(edges_m, 4)               /* of x, of y: where training ended */                                                 \
    X(spread_m, 2)                                                                                                     \
    X(force_bins, 1)                                                                                                   \
    X(force_bin_n, FMFTS_BINS)  /* upper ends of all bins but the last */                                              \
    X(radius_bins, 1)                                                                                                  \
    X(radius_bin_m, FMFTS_BINS)                                                                                        \
    X(own_deviation, 3 * FMFTS_BINS * FMFTS_BINS)                                                                      \
    X(trained_force_n, FMFTS_BINS * FMFTS_BINS)                                                                        \
    X(slipping_n, FMFTS_BINS)   /* by radius */                                                                        \
    X(rest_variance, 6)         /* contact_message.py */                                                               \
    X(remanence_t, 1)                                                                                                  \
    X(ambient_t, 3)             /* NaN: not measured */                                                                \
    X(ambient_variance, 3)

/* What one frame leaves to the next. */
#define FMFTS_MEMORY(X)                                                                                                \
    X(field_t, 3 * FMFTS_AXES)  /* three newest samples, newest first */                                               \
    X(time_us, 3 * FMFTS_SENSORS)                                                                                      \
    X(repeats, FMFTS_AXES)                                                                                             \
    X(last_us, 1)                                                                                                      \
    X(state, FMFTS_STATE)                                                                                              \
    X(covariance, FMFTS_STEP * FMFTS_STEP)                                                                             \
    X(warmth_variance, 1)                                                                                              \
    X(misfit, 1)                                                                                                       \
    X(mean_t, FMFTS_AXES)       /* of the residuals */                                                                 \
    X(lasting_t2, FMFTS_AXES)                                                                                          \
    X(frames, FMFTS_AXES)                                                                                              \
    X(change, FMFTS_CHANGE)                                                                                            \
    X(pushed, 1)                                                                                                       \
    X(since, 1)                                                                                                        \
    X(sound, 1)                                                                                                        \
    X(was_sound, 1)             /* at any judgement since Python handed over */                                        \
    X(lasting_misfit, 1)                                                                                               \
    X(passed, 1)                /* frames since then */                                                                \
    X(touched, 1)                                                                                                      \
    X(quiet_frames, 1)

/* Numbers of a message. */
#define FMFTS_NUMBERS(X)                                                                                               \
    X(temperature_c, 1)                                                                                                \
    X(x_m, 1)                                                                                                          \
    X(x_sd_m, 1)                                                                                                       \
    X(y_m, 1)                                                                                                          \
    X(y_sd_m, 1)                                                                                                       \
    X(force_n, 1)                                                                                                      \
    X(force_sd_n, 1)                                                                                                   \
    X(force_min_n, 1)                                                                                                  \
    X(position_m, 3)                                                                                                   \
    X(position_sd_m, 3)                                                                                                \
    X(axis, 3)                                                                                                         \
    X(axis_sd_rad, 1)                                                                                                  \
    X(remanence_t, 1)                                                                                                  \
    X(remanence_sd_t, 1)                                                                                               \
    X(ambient_t, 3)                                                                                                    \
    X(ambient_sd_t, 3)                                                                                                 \
    X(residual_t, 1)                                                                                                   \
    X(chi2, 1)

#define FMFTS_FIELD(name, count) double name[count];
typedef struct {
    FMFTS_FACTS(FMFTS_FIELD)
} fmfts_facts;
typedef struct {
    FMFTS_MEMORY(FMFTS_FIELD)
} fmfts_memory;
typedef struct {
    FMFTS_NUMBERS(FMFTS_FIELD)
} fmfts_numbers;
#undef FMFTS_FIELD

/* One reading as it came; readings: per sensor x, y, z and age in µs, little-endian, as docs/wire.md has them. */
typedef struct {
    const uint8_t *readings;
    double time_us;
    double temperature_c; /* NaN: unknown */
    unsigned gain_code, valid, fresh;
} fmfts_frame;

/* The field (T, sensor axes) at one instant, and what is known of its errors: alignment.py, mounting.py. */
typedef struct {
    double instant_us;
    double field_t[FMFTS_AXES];
    double lasting_t2[FMFTS_AXES]; /* of the variance: what no averaging takes away, baseline aside */
    double variance_t2[FMFTS_AXES];
} fmfts_field;

typedef struct {
    double covariance[FMFTS_STEP * FMFTS_STEP]; /* widened by the misfit of late */
    double chi2, residual_t;
} fmfts_pose;

/* Between the pose and the contact model's answer. */
typedef struct {
    double pose[6];
    double covariance[36];
    double share;
    double touching;
    double instant_us;
} fmfts_question;

/* The contact model's answer in its units, mm and N, and the variance that the pose's own makes of it. */
typedef struct {
    double contact[3];
    double variance[3];
} fmfts_found;

/* What a touched, or an untouched, pad publishes. */
typedef enum { FMFTS_QUIET, FMFTS_TOUCHED, FMFTS_OVER_RANGE, FMFTS_NO_NUMBER } fmfts_contact;

/* alignment.c: the frame's field, baseline subtracted, at one instant. */
bool fmfts_align(const fmfts_facts *facts, fmfts_memory *memory, const fmfts_frame *frame, fmfts_field *field);

/* tracker.c: the magnet's state from the field and the frame before; into `memory`. */
bool fmfts_track(const fmfts_facts *facts, fmfts_memory *memory, const fmfts_field *field, double temperature_c,
                 fmfts_pose *pose);

/* innovation.c: adds the residuals to their mean; false where the mean is not that of healthy sensors. */
bool fmfts_watch(const fmfts_facts *facts, fmfts_memory *memory, const fmfts_field *field);

/* touch.c: touched or not, and what the contact model is to be asked. */
bool fmfts_ask(const fmfts_facts *facts, fmfts_memory *memory, const fmfts_pose *pose, fmfts_question *question,
               fmfts_numbers *numbers);

/* estimate.c: the network's answer, contact [3] and jacobian [3][6], in the model's units. */
void fmfts_take_answer(const fmfts_question *question, const float *contact, const float *jacobian,
                       fmfts_found *found);

/* estimate.c: the most likely press instead, by the pad's response; false where there is none. */
bool fmfts_refine_answer(const fmfts_facts *facts, const fmfts_question *question, const fmfts_response *response,
                         fmfts_found *found);

/* estimate.c: a contact as numbers to publish. */
fmfts_contact fmfts_answer(const fmfts_facts *facts, const fmfts_question *question, const fmfts_found *found,
                           fmfts_numbers *numbers);

/* message.c: into `text` [size], at the places of its integers and then of every number; a place below zero is none. */
enum { FMFTS_MESSAGE_INTEGERS = 4, FMFTS_NUMBER_COUNT = sizeof(fmfts_numbers) / sizeof(double) };
void fmfts_fill(uint8_t *text, size_t size, const int32_t *place, const unsigned long long *integer,
                const fmfts_numbers *numbers);

#endif
