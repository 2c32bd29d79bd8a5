/* A healthy frame, from the change of pose to a contact: touch.c, smooth.c, estimate.c, network.c and refine.c. The reference is the
 * Python beside them. */
#ifndef FMFTS_CONTACT_STEP_H
#define FMFTS_CONTACT_STEP_H

#include <stdbool.h>

#include "../common/double_table.h"
#include "network.h"
#include "refine.h"

enum { FMFTS_BINS = 16, FMFTS_POSE = FMFTS_NETWORK_POSE, FMFTS_CONTACT = FMFTS_MAX_OUTPUTS };

/* What these steps need of a contact model and a touch detector. Units of the model: mm, N, and components of the axis. */
#define FMFTS_CONTACT_PARAMETERS(X)                                                                                    \
    X(onset_chi2, 1)            /* touch.py */                                                                         \
    X(release_chi2, 1)                                                                                                 \
    X(release_frames, 1)                                                                                               \
    X(longest_gap_s, 1)                                                                                                \
    X(refine_steps, 1)          /* refinement.py, if the model refines */                                              \
    X(least_variance, 1)        /* added to each component of the covariance */                                        \
    X(model_rest, 6)            /* model.py */                                                                         \
    X(lowest, 6)                                                                                                       \
    X(highest, 6)                                                                                                      \
    X(outside_deviations, 1)                                                                                           \
    X(certain_deviations, 1)                                                                                           \
    X(kept_force_deviations, 1)                                                                                        \
    X(certain_force_deviations, 1)                                                                                     \
    X(hidden_force_sd_n, 1)                                                                                            \
    X(straight_share, 1)                                                                                               \
    X(bend_deviations, 1)                                                                                              \
    X(trained_top_mm, 1)                                                                                               \
    X(lifted_above_mm, 1)                                                                                              \
    X(lifted_deviations, 1)                                                                                            \
    X(force_max_n, 1)                                                                                                  \
    X(edges_m, 4)               /* the calibrated range of x and y */                                                  \
    X(magnet_off_m, 2)          /* from the drawing's place */                                                         \
    X(spread_m, 2)                                                                                                     \
    X(force_bins, 1)                                                                                                   \
    X(force_bin_n, FMFTS_BINS)  /* upper ends of all bins but the last */                                              \
    X(radius_bins, 1)                                                                                                  \
    X(radius_bin_m, FMFTS_BINS)                                                                                        \
    X(own_deviation, FMFTS_CONTACT * FMFTS_BINS * FMFTS_BINS) /* [force][radius][outputs] */                           \
    X(trained_force_n, FMFTS_BINS * FMFTS_BINS)                                                                        \
    X(slipping_n, FMFTS_BINS)   /* by radius */                                                                        \
    X(smoothing_s, 1)           /* smoothing.py; 0: none */                                                            \
    X(smoothing_jump_chi2, 1)

#define FMFTS_CONTACT_MEMORY(X)                                                                                        \
    X(touched, 1)                                                                                                      \
    X(quiet_frames, 1)                                                                                                 \
    X(in_contact, 1)                                                                                                   \
    X(pose, 6)                  /* smoothing.py, in m and components of the axis */                                    \
    X(speed, 6)                                                                                                        \
    X(acceleration, 6)

FMFTS_STRUCT(fmfts_contact_parameters, FMFTS_CONTACT_PARAMETERS)
FMFTS_STRUCT(fmfts_contact_memory, FMFTS_CONTACT_MEMORY)

/* The input of the contact model, in its units. share: see ContactModel._share_inside. */
typedef struct {
    double pose[FMFTS_POSE];
    double covariance[FMFTS_POSE * FMFTS_POSE];
    double share;
} fmfts_question;

/* place: x, y (m), force and, of a model that tells them, two shears (N), with deviations. The others are as in ContactEstimate.
 * doubt: see estimate.py. */
typedef struct {
    int outputs; /* 3 or 5 */
    double place[FMFTS_CONTACT];
    double deviation[FMFTS_CONTACT];
    double by_pose[FMFTS_CONTACT * FMFTS_POSE]; /* the network's Jacobian, in the model's units */
    double force_min_n, central_force_sd_n, pose_force_sd_n, doubt;
    bool over_range, refused;
} fmfts_estimate;

/* touch.c: χ² of a change of pose [5] with its covariance [5][5]. False if that is not one. */
bool fmfts_chi2_from_rest(const double *change, const double *covariance, double *chi2);

/* touch.c: updates memory->touched from the change of pose [5] and its covariance [5][5]. elapsed_s: since the frame
 * before. False if that is no covariance. */
bool fmfts_touch(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, const double *change,
                 const double *covariance, double elapsed_s);

/* touch.c: updates memory->in_contact, by the estimate of the frame that fmfts_touch judged. */
void fmfts_press(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, const fmfts_estimate *estimate);

/* smooth.c: smooths the pose of the question, if that is configured. False if its covariance is none. */
bool fmfts_smooth(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, double elapsed_s,
                  fmfts_question *question);

/* estimate.c: moves the question into the range that the model was trained on. False if the magnet is lifted. */
bool fmfts_keep_inside(const fmfts_contact_parameters *parameters, fmfts_question *question);

/* estimate.c: the network's answer; if response is not NULL, the most likely press near it. False if the answer is not
 * finite. */
bool fmfts_estimate_contact(const fmfts_contact_parameters *parameters, const fmfts_question *question,
                            const fmfts_network *network, const void *response, size_t response_bytes,
                            fmfts_estimate *estimate);

#endif
