/* A healthy frame, from the change of pose to a contact: touch.c, smooth.c, estimate.c, explained.c, tolerances.c,
 * network.c, response.c, refine.c and elsewhere.c. */
#ifndef FMFTS_CONTACT_STEP_H
#define FMFTS_CONTACT_STEP_H

#include <stdbool.h>

#include "../common/fields.h"
#include "../pose/magnets.h"
#include "network.h"
#include "refine.h"

enum { FMFTS_BINS = 16, FMFTS_RINGS = 8, FMFTS_POSE = FMFTS_NETWORK_POSE, FMFTS_CONTACT = FMFTS_MAX_OUTPUTS };

/* A force is certain, and a contact begins, if it is so many deviations above zero. */
#define FMFTS_CERTAIN_FORCE_DEVIATIONS 2.0

/* in_contact of the memory, if not 0: the force is certain; only that something presses; or that something has begun to. */
#define FMFTS_SURE_FORCE 1.0
#define FMFTS_SURE_PRESS 2.0
#define FMFTS_RECENT_PRESS 3.0

/* A contact begins where a press explains this share of the movement. */
#define FMFTS_EXPLAINED_SHARE 0.75

/* A contact ends when so many frames in a row are as close to rest as 99 % of unloaded frames. */
#define FMFTS_RELEASE_FRAMES 5

/* What these steps need of a contact model and a touch detector. Units of the model: mm, N, and components of the axis. */
#define FMFTS_CONTACT_PARAMETERS(ONE, MANY)                                                                                    \
    ONE(double, onset_chi2) /* touch.py */                                                                             \
    ONE(double, release_chi2)                                                                                          \
    ONE(double, longest_gap_s)                                                                                         \
    ONE(double, refine_steps) /* refinement.py, if the model refines */                                                \
    ONE(double, shear_share) /* model.py: of a model that solves shear, the prior deviation of each, over the force; else 0 */ \
    ONE(double, least_variance) /* added to each component of the covariance */                                        \
    MANY(double, model_rest, 6) /* model.py */                                                                         \
    MANY(double, lowest, 6)                                                                                            \
    MANY(double, highest, 6)                                                                                           \
    ONE(double, outside_deviations)                                                                                    \
    ONE(double, hidden_force_sd_n)                                                                                     \
    ONE(double, trained_top_mm)                                                                                        \
    ONE(double, force_max_n)                                                                                           \
    MANY(double, edges_m, 4) /* the calibrated range of x and y */                                                     \
    MANY(double, magnet_off_m, 2) /* from the drawing's place */                                                       \
    MANY(double, spread_m, 2)                                                                                          \
    ONE(double, force_bins)                                                                                            \
    MANY(double, force_bin_n, FMFTS_BINS) /* upper ends of the bins; the last has none */                              \
    ONE(double, radius_bins)                                                                                           \
    MANY(double, radius_bin_m, FMFTS_BINS)                                                                             \
    MANY(double, own_deviation, FMFTS_CONTACT * FMFTS_BINS * FMFTS_BINS) /* [force][radius][outputs] */                \
    MANY(double, trained_force_n, FMFTS_BINS * FMFTS_BINS)                                                             \
    MANY(double, slipping_n, FMFTS_BINS) /* by radius */                                                               \
    ONE(double, modulus) /* tolerances.c, as the next six */                                                           \
    ONE(double, finger_mm2)                                                                                            \
    ONE(double, known_finger_mm2)                                                                                      \
    ONE(double, ring_mm)                                                                                               \
    MANY(double, thicker_mm, FMFTS_RINGS)                                                                              \
    MANY(double, thicker_share, FMFTS_RINGS)                                                                           \
    ONE(double, smoothing_s) /* smooth.c; 0: none */                                                                   \
    ONE(double, smoothing_jump_chi2)

#define FMFTS_CONTACT_MEMORY(ONE, MANY)                                                                                        \
    ONE(double, touched)                                                                                               \
    ONE(double, quiet_frames)                                                                                          \
    ONE(double, in_contact)                                                                                            \
    ONE(double, doubtful_frames) /* how many frames old a contact is that is not published yet; 0: none */             \
    ONE(double, recent_moved_s) /* pipeline/recent_rest.c: how long the pose has differed from the recent rest */      \
    MANY(double, recent_change, 5) /* of that rest, since the baseline */                                              \
    MANY(double, recent_ambient_t, 3)                                                                                  \
    ONE(int64_t, smooths) /* smooth.c: whether there was a pose before */                                              \
    MANY(double, pose, 6) /* in m and components of the axis */                                                        \
    MANY(double, speed, 6)                                                                                             \
    MANY(double, acceleration, 6)

FMFTS_STRUCT(fmfts_contact_parameters, FMFTS_CONTACT_PARAMETERS)
FMFTS_STRUCT(fmfts_contact_memory, FMFTS_CONTACT_MEMORY)

/* The input of the contact model, in its units. share: the largest share (at most 1) of the displacement from rest
 * within the range of the training. Displacement grows with force at every place, so a share of it never means a larger
 * force. lifted_m: how far the magnet certainly is above that range; 0 if it is not. */
typedef struct {
    double pose[FMFTS_POSE];
    double covariance[FMFTS_POSE * FMFTS_POSE];
    double share, lifted_m;
} fmfts_question;

/* A model's answer in mm and N, and its derivative by the pose. */
typedef struct {
    int outputs; /* 3 or 5 */
    const double *contact, *by_pose;
} fmfts_answer;

/* place: x, y (m), force and, with a shear model, two shears (N), with deviations. central_force_sd_n: the deviation
 * of the same force in the middle of the pad; pose_force_sd_n: the part of it that the pose causes; own_force_sd_n:
 * that of the force without the uncertainty of the pad's structure, which decides contacts; refused: shear and place
 * cannot be separated here, so no number is valid. explained: the share of the magnet's movement that a press explains, and lowered_chi2:
 * by how much it lowers χ², 0 if not computed; is_beyond: it is beyond the range of the training. doubt: see estimate.c. */
typedef struct {
    int outputs; /* 3 or 5 */
    double place[FMFTS_CONTACT];
    double deviation[FMFTS_CONTACT];
    double by_pose[FMFTS_CONTACT * FMFTS_POSE]; /* the network's Jacobian, in the model's units */
    double force_min_n, central_force_sd_n, pose_force_sd_n, own_force_sd_n, doubt, explained, lowered_chi2;
    bool over_range, refused, is_beyond;
} fmfts_estimate;

/* touch.c: χ² of a change of pose [numbers], at most FMFTS_MOST_CHANGE, with its covariance [numbers][numbers]. False if that is not one. */
bool fmfts_chi2_from_rest(size_t numbers, const double *change, const double *covariance, double *chi2);

/* touch.c: updates memory->touched from the change of pose and its covariance, as for fmfts_chi2_from_rest. False, and
 * nothing changes, if χ² is not known. */
bool fmfts_touch(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, size_t numbers,
                 const double *change, const double *covariance);

/* touch.c: updates memory->in_contact, by the estimate of the frame that fmfts_touch judged. */
void fmfts_press(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, const fmfts_estimate *estimate);

/* touch.c, after fmfts_press: begins a contact, or goes on with it. was_contact: before this frame. drift_explains: whether offsets that
 * drift with the warmth may have caused the frame's touch. */
void fmfts_doubt_drift(fmfts_contact_memory *memory, bool was_contact, bool drift_explains);

/* touch.c: whether the memory's contact is to be published. */
bool fmfts_is_published(const fmfts_contact_memory *memory);

/* touch.c: a frame without a pose. After some of them the contact is released, and a new one needs an onset. */
void fmfts_unseen(fmfts_contact_memory *memory);

/* touch.c: restarts, untouched. */
void fmfts_forget_touch(fmfts_contact_memory *memory);

/* explained.c: the share of a change of pose that the press of `answer` (mm, N) explains or, if that is not enough, the most likely one near
 * it. search: its change and covariance, in the table's units, and the prior of shear. lowered_chi2: by how much that press lowers
 * χ² of the change. */
double fmfts_explained_share(const fmfts_response *table, const fmfts_press_search *search, const double *answer, double enough,
                             double *lowered_chi2);

/* smooth.c: smooths the pose of the question, if that is configured. */
void fmfts_smooth(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, double elapsed_s,
                  fmfts_question *question);

/* estimate.c: moves the question into the range of the training. */
void fmfts_keep_inside(const fmfts_contact_parameters *parameters, fmfts_question *question);

/* tolerances.c: the variance of an answer (mm and N, with its Jacobian by the pose) from the uncertainty of the pad's
 * structure. response: NULL if it is not known. */
void fmfts_count_tolerances(const fmfts_contact_parameters *parameters, const fmfts_response *response,
                           const fmfts_question *question, const fmfts_answer *answer, double variance[FMFTS_CONTACT]);

/* tolerances.c: the additional movement under `press` for a finger whose second moment along x, or y, exceeds the
 * probe's by wider_mm2 (negative: smaller). */
void fmfts_wider_finger(const fmfts_response *response, const double press[FMFTS_CONTACT], double wider_mm2, double more[2][FMFTS_MOVED]);

/* tolerances.c: the additional movement under `press` by a disc whose second moments exceed the probe's by
 * wider_mm2. */
void fmfts_wider_disc(const fmfts_response *response, const double press[FMFTS_CONTACT], double wider_mm2, double more[FMFTS_MOVED]);

/* tolerances.c: takes from the pose what a finger of a known width adds to the movement under `press`: what is left is the movement by
 * the probe. */
void fmfts_take_known_finger(const fmfts_contact_parameters *parameters, const fmfts_response *response,
                             const double press[FMFTS_CONTACT], double pose[FMFTS_POSE]);

/* estimate.c: the network's answer, and of a model that refines or solves shear, the most likely press near it.
 * response: NULL if it is not known; then nothing is refined. False if the answer is not finite. */
bool fmfts_estimate_contact(const fmfts_contact_parameters *parameters, const fmfts_question *asked,
                            const fmfts_network *network, const void *response, size_t response_bytes,
                            fmfts_estimate *estimate);

#endif
