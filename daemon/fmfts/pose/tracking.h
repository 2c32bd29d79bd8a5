/* Internal to the tracker: what tracker.c shares with gate.c, frame_solver.c, fault_search.c and ambient_motion.c. */
#ifndef FMFTS_TRACKING_H
#define FMFTS_TRACKING_H

#include <math.h>

#include "solver.h"
#include "step.h"

/* While a disturbance lasts, the search for a single faulty sensor is repeated once in so many frames. It is slow: it
 * takes many solves, which converge slowly because none fits. */
enum { FMFTS_SEARCH_EVERY = 8 };

/* A pad's first frame finds the ambient field and the pose together, and may take steel for both: no later frame then fits
 * beside that field. So it is trusted only after so many frames in which it was as strong as the Earth's. */
enum { FMFTS_TRUSTED_FRAMES = 44 };

/* A magnet whose moment is off by this factor (3) is not the pad's. */
static const double FMFTS_LOG_MOMENT_REACH = 1.0986122886681098;

/* The state before a frame is measured: its most likely value, and the covariance of a step from there. warmth_variance: what
 * warming adds to that of the log moment, in total. */
typedef struct {
    double state[FMFTS_STATE], covariance[FMFTS_STEP * FMFTS_STEP], warmth_variance;
} fmfts_prior;

/* One way to solve a frame. field_t: NaN leaves an axis out. has_foreign_field: a foreign field is unknown, too.
 * is_doubtful: it will probably not fit, so a rough solution suffices at first. */
typedef struct {
    fmfts_step *step;
    const fmfts_prior *prior;
    double field_t[FMFTS_AXES];
    bool has_foreign_field, is_doubtful;
} fmfts_attempt;

/* The most likely state. placed: of the neighbours' magnets in it. Without an estimate, covariance and chi2 are NaN. */
typedef struct {
    fmfts_status status;
    int freedom; /* degrees of freedom: measured values without the unknowns */
    double chi2, residual_t;
    double state[FMFTS_STATE], covariance[FMFTS_STEP * FMFTS_STEP];
    double placed[FMFTS_FELT][FMFTS_PLACED];
} fmfts_solved;

/* gate.c: the largest log moment, above that at rest, of the pad's own magnet. */
double fmfts_strongest(const fmfts_pose_parameters *parameters);

/* gate.c: whether the solve converged to a pose that this pad's magnet can have, and that is known well enough. strongest: the
 * largest log moment, above that at rest. */
bool fmfts_has_plausible_pose(const fmfts_pose_parameters *parameters, const fmfts_solved *solved, double strongest);

/* gate.c: whether the pose is plausible and the frame's χ² passes the gate. */
bool fmfts_fits(const fmfts_pose_parameters *parameters, const fmfts_solved *solved, double strongest);

/* gate.c: the same, with the moment's misfit in χ². */
bool fmfts_fits_steadily(const fmfts_pose_parameters *parameters, const fmfts_solved *solved, const fmfts_misfit *misfit);

/* gate.c: whether few healthy frames fit as badly as this one. */
bool fmfts_surprises(const fmfts_step *step);

/* alternating.c: notes that a single frame blames this sensor. */
void fmfts_note_blame(fmfts_pose_memory *memory, int sensor);

/* alternating.c: the sensors [mask] that one of the last `frames` blamed, at most 39. */
unsigned fmfts_blamed_within(const fmfts_pose_memory *memory, int frames);

/* steady_moment.c: whether each frame estimates the moment, and that of recent frames is known. */
bool fmfts_knows_moment(const fmfts_step *step);

/* steady_moment.c: how the solution fits, with the moment of recent frames as one more measurement; remembers its moment. */
void fmfts_compare_moment(fmfts_step *step, const fmfts_solved *solved);

/* gate.c: the probability that a healthy frame has a larger χ² than this one; zero without a plausible pose. */
double fmfts_probability(const fmfts_pose_parameters *parameters, const fmfts_solved *solved);

/* frame_solver.c: the field [axes] as measurements [axes][FMFTS_MEASUREMENT], with the deviations of the step's field. */
void fmfts_write_measurements(const fmfts_step *step, const double *field_t, double *row);

/* frame_solver.c: solves from the prior's state. If that finds no plausible pose, and this frame searches, solves also
 * from rest. A doubtful solution stays rough unless it fits. */
void fmfts_solve_frame(const fmfts_attempt *attempt, fmfts_solved *solved);

/* tracker.c: the sensors [mask] all of whose axes are measured in `field_t`. */
unsigned fmfts_whole_sensors(const fmfts_pose_parameters *parameters, const double field_t[FMFTS_AXES]);

/* tracker.c: how many sensors are in the mask. */
int fmfts_count(unsigned mask);

/* tracker.c: appends what is wrong with the sensors that are not in the mask `whole`. */
void fmfts_say_why_not(const fmfts_step *step, unsigned whole, fmfts_text *text);

/* tracker.c: notes a plausible state: residuals are formed with it. */
void fmfts_note_nearest(fmfts_step *step, const fmfts_solved *solved);

/* tracker.c: the memory goes on from this state, which is the frame's estimate. */
void fmfts_accept(fmfts_step *step, const fmfts_prior *prior, const fmfts_solved *solved);

/* fault_search.c: the verdict on a frame that does not fit: degraded if one sensor is to blame, or disturbed, or lost.
 * whole: the solution of this attempt. */
void fmfts_explain(const fmfts_attempt *attempt, const fmfts_solved *whole);

#endif
