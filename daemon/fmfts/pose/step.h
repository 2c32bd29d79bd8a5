/* A frame, from counts to pose: alignment.c, neighbour.c, tracker.c, residual_monitor.c, ambient_motion.c, hidden_gradient.c and
 * change.c, in this order; pipeline/frame.c calls them. Re-entrant: no allocation, no globals. SI units unless a name says
 * otherwise. Arrays are row-major. What a frame leaves to the next is in fmfts_pose_memory and nowhere else.
 */
#ifndef FMFTS_POSE_STEP_H
#define FMFTS_POSE_STEP_H

#include <stdbool.h>
#include <stdint.h>

#include "../common/text.h"
#include "../sensor/missing.h"
#include "beside.h"
#include "joints.h"
#include "pose_fields.h"

/* The neighbours' magnets at one instant, in this pad's axes. covariance: of a step of all, [FMFTS_MOVES × count]². */
typedef struct {
    size_t count;
    double magnet[FMFTS_FELT][FMFTS_MAGNET];
    double rest[FMFTS_FELT][FMFTS_PLACED], now[FMFTS_FELT][FMFTS_PLACED];
    double covariance[FMFTS_MOVES * FMFTS_FELT * FMFTS_MOVES * FMFTS_FELT];
    double rest_error[FMFTS_FELT][2], placement_m[FMFTS_FELT];
} fmfts_felt;

/* What the joints of the pad's hand do to its field: hand.py. Pointers into doubles that Python owns, in its order: [axes] each.
 * state: see joints.h; NULL: the pad is on no hand that moves. rates: per second from time_ns on. Variances of
 * independent errors. wide: those of any posture. */
typedef struct {
    double *state, *time_ns, *field_t, *rate_t_per_s, *variance_t2, *rate_variance, *wide_field_t, *wide_variance_t2;
} fmfts_hand;

/* The errors that the baseline leaves: FieldErrors.table [causes][FMFTS_CHANGE][axes], of one deviation of a cause. */
typedef struct {
    size_t axes, causes;
    const double *table;
} fmfts_field_errors;

/* The Earth's field at the baseline, and its strength: Reference of hidden_gradient.py. */
typedef struct {
    double field_t[3], strength_t;
} fmfts_reference;

/* One raw frame. readings: per sensor x, y, z and age in µs, little-endian, as in firmware/wire.md. Masks: bit i for sensor i. */
typedef struct {
    const uint8_t *readings;
    int64_t time_us, host_ns; /* the same instant on the board's clock and on the host's */
    int64_t sequence;
    double temperature_c; /* NaN: unknown */
    unsigned gain_code, valid, fresh;
} fmfts_frame;

/* The field (T, sensor axes) at one instant, and the variance of its errors; NaN where it was not measured. */
typedef struct {
    int64_t instant_us;
    bool is_old, began_anew; /* no new sample came for too long; the board's clock restarted */
    int64_t leap_us;         /* the jump of that clock before this frame, beyond the time that passed */
    double elapsed_s;        /* since the last frame's instant */
    double field_t[FMFTS_AXES];
    double bend_t[FMFTS_AXES];     /* the error that curvature between two samples may cause */
    double noise_share[FMFTS_SENSORS];
    double unknown_t2[FMFTS_AXES]; /* variance of what the baseline leaves unknown */
    double other_t2[FMFTS_AXES];   /* from curvature, warming and neighbours; averaging does not reduce it */
    double variance_t2[FMFTS_AXES]; /* of all, with noise */
} fmfts_field;

/* The last two: no frame of this pad can be used. */
typedef enum {
    FMFTS_OK, FMFTS_DEGRADED, FMFTS_DISTURBED, FMFTS_LOST, FMFTS_NO_BASELINE, FMFTS_STALE, FMFTS_DISCONNECTED,
    FMFTS_HEALTHS /* how many there are */
} fmfts_health;

/* The verdict on a frame. used: the axes that the estimate was solved from. has_estimate: the memory's state is this
 * frame's, and `pose` belongs to it. stronger: the frame fits a magnet that is stronger than at its baseline, which no
 * magnet is. */
typedef struct {
    fmfts_health health;
    fmfts_text reason; /* empty if ok */
    bool has_estimate, stronger;
    bool used[FMFTS_AXES];
} fmfts_verdict;

typedef struct {
    double covariance[FMFTS_STEP * FMFTS_STEP]; /* covariance of the memory's state, widened by the recent misfit */
    double chi2, residual_t;
} fmfts_pose;

/* How well the most likely pose explains all measurements, and the error of the moment (steady_moment.c), in
 * deviations. */
typedef struct {
    bool known;
    int freedom;
    double chi2, moment;
} fmfts_misfit;

/* The most likely state of a frame, even of one that does not fit, with its covariance. Residuals are formed with it.
 * known: there is a plausible one. placed: where the neighbours' magnets are in it. */
typedef struct {
    bool known;
    double state[FMFTS_STATE];
    double placed[FMFTS_FELT][FMFTS_PLACED];
} fmfts_nearest;

/* change: of pose from rest, position and axis in the rest axis's tangent plane. basis: the estimate's tangents. turn: from
 * the estimate's tangents to those at rest. */
typedef struct {
    double change[5];
    double covariance[5][5]; /* over position and the estimate's tangents, with what mounting leaves unknown */
    double at_rest[25];      /* the covariance [5][5] of `change` */
    double basis[2][3];
    double turn[2][2];
} fmfts_displacement;

/* One frame from counts to pose: each step below reads and writes it. `memory` is kept for the next frame. */
typedef struct {
    const fmfts_pose_parameters *parameters;
    fmfts_pose_memory *memory;
    fmfts_field_errors errors;
    double temperature_c; /* NaN: unknown */
    fmfts_missing missing;
    fmfts_field field;
    fmfts_felt felt;
    fmfts_posture posture;
    double joints_later_s; /* the frame's time since the newest joint positions */
    fmfts_pose pose;
    fmfts_nearest nearest;
    fmfts_verdict verdict;
    fmfts_misfit misfit;
    double residual_t[FMFTS_AXES]; /* residual_monitor.c: residuals from `nearest`, if that is known */
    double slopes[FMFTS_AXES][FMFTS_STEP]; /* derivatives of the prediction by a step from `nearest` */
} fmfts_step;

/* alignment.c: what a count of an axis is. */
typedef enum { FMFTS_A_FIELD, FMFTS_SATURATED, FMFTS_NO_COUNT } fmfts_counted;
fmfts_counted fmfts_judge_count(const fmfts_pose_parameters *parameters, int count);

/* alignment.c: the field in tesla of a count of this axis (0 to 2), NaN if it is none. */
double fmfts_field_of_count(const fmfts_pose_parameters *parameters, unsigned gain_code, int axis, int count);

/* alignment.c: takes the frame's samples into the memory, and interpolates them to one instant; notes what is
 * missing. */
void fmfts_align(fmfts_step *step, const fmfts_frame *frame);

/* alignment.c: leaves out stuck axes, subtracts the baseline, and adds up the deviations. */
void fmfts_subtract(fmfts_step *step);

/* alignment.c: whether the time of the last change of field is unknown for a sample of any axis. */
bool fmfts_has_jumped(const fmfts_step *step);

/* alignment.c: the variance of an axis that the baseline leaves, at a change [3] of its sensor's field from rest. The
 * errors are proportional to the field. The pose at rest contains those at rest, so only those of the change count. */
double fmfts_lasting_variance(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, int axis,
                              const double change[3]);

/* neighbour.c: finds the neighbours at `time_ns` (host's clock), from where they were last seen (one for each pad); adds their
 * field at rest, which the baseline has subtracted, and the variance of their places. */
void fmfts_feel(fmfts_step *step, const fmfts_sighting *seen, double time_ns);

/* posture.c: subtracts the field of the hand's posture at `time_ns` (host's clock), and adds the variance of its
 * errors. */
void fmfts_take_posture(fmfts_step *step, const fmfts_hand *hand, double time_ns);

/* posture.c: a frame whose posture is not known is degraded at best, and says why. */
void fmfts_doubt_posture(fmfts_step *step);

/* neighbour.c: the field [axes] without that of the neighbours at `placed`, as they were solved. */
void fmfts_take_neighbours(const fmfts_step *step, const double placed[][FMFTS_PLACED], double field_t[FMFTS_AXES]);

/* neighbour.c: the reference of hidden_gradient.c. */
fmfts_reference fmfts_reference_beside(const fmfts_pose_parameters *parameters, const fmfts_felt *felt);

/* tracker.c: solves for the magnet's state from the last good one, and judges the frame alone: ok; degraded, without
 * missing or contradicting sensors; or no pose of this magnet. If it fits, the memory goes on from it. */
void fmfts_track(fmfts_step *step);

/* tracker.c, after residual_monitor.c: where the scene says that steel may be near, a frame that left out a measured axis is
 * disturbed. */
void fmfts_doubt_beside_steel(fmfts_step *step);

/* residual_monitor.c: averages the residuals, judges their mean from time to time, and overrules the verdict on the frame. */
void fmfts_watch_residuals(fmfts_step *step);

/* further_drift.c: the variance of the chips' offset drift since rest, by the last temperature. */
double fmfts_drift_t2(const fmfts_step *step);

/* further_drift.c: by how much the variance of a pose would grow if offsets had drifted as far since the baseline as a mean may
 * hide; 0 on a pad that has not warmed. */
double fmfts_hidden_drift_share(const fmfts_step *step);

/* residual_monitor.c: the sensor that is excluded because its mean residual contradicts the others; negative: none. */
int fmfts_blamed(const fmfts_pose_memory *memory);

/* residual_monitor.c: whether to believe a single frame that blames this sensor. */
bool fmfts_confirms(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, int sensor);

/* ambient_motion.c: where the scene calls the ambient field constant, finds that it moves; the frame is then disturbed. */
void fmfts_watch_ambient(fmfts_step *step);

/* Factor of the alternating field's variance: errors of a chip's three axes are correlated, and independent errors of
 * three times the variance are never smaller. */
#define FMFTS_ALTERNATING_SHARE 3.0

/* alternating.c: detects an alternating field, or samples that scatter more than at the baseline, reports it, and
 * widens the deviations. */
void fmfts_watch_alternation(fmfts_step *step);

/* overlap.c: the part of the memory's covariance of the pose that the baseline's leftovers count, too. */
void fmfts_overlap(const fmfts_step *step, bool moment_is_given, double overlap[5][5]);

/* change.c: the change [5] of pose since rest. */
void fmfts_change(const fmfts_pose_parameters *parameters, const double *state, double change[5]);

/* change.c: the same, and its covariance. memory: of the loads that the silicone has borne. overlap: the part of the pose's
 * covariance that the leftovers count, too; NULL: nothing. */
void fmfts_displace(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double *state,
                    const fmfts_pose *pose, const double overlap[5][5], fmfts_displacement *d);

/* change.c: how far (m) the change moved the magnet's centre, and the deviation along that direction. Without a
 * direction: the largest of the three deviations. */
void fmfts_distance(const fmfts_displacement *d, double *moved_m, double *deviation_m);

/* silicone.c: notes in `memory` the load of its state. elapsed_s: since the last frame. If a frame's pose cannot be
 * trusted, do not call it: add that time to `unseen_s`. */
void fmfts_follow_creep(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, double elapsed_s);

/* silicone.c: adds to `covariance` what silicone leaves uncertain of the change of pose. */
void fmfts_creep(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double change[5],
                 double covariance[5][5]);

/* change.c: adds to the covariance of `state`'s pose that of a change of pose, over the rest axis's tangents. */
void fmfts_widen(const fmfts_pose_parameters *parameters, const double *state, const double added[5][5], fmfts_pose *pose);

/* hidden_gradient.c: notes the foreign field that the ambient field shows, and adds its uncertainty to the pose's
 * covariance; if that is too large, the frame is disturbed. Does nothing without an estimate. */
void fmfts_follow_foreign(fmfts_step *step);

/* hidden_gradient.c: the same addition, to the covariance of another `state`. */
void fmfts_widen_by_foreign(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const double *state,
                            fmfts_pose *pose);

/* change.c: the pose in the drawing's frame: NominalFrame of drawn.py. pose [6]: position (× unit_per_m) and axis; covariance [6][6]. */
void fmfts_draw(const fmfts_pose_parameters *parameters, const double *state, const fmfts_displacement *d,
                double unit_per_m, double pose[6], double covariance[36]);

#endif
