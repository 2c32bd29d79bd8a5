/* A healthy frame, from the change of pose to a contact: touch.c, estimate.c and network.c, each beside its Python. */
#ifndef FMFTS_CONTACT_STEP_H
#define FMFTS_CONTACT_STEP_H

#include <stdbool.h>

#include "../common/double_table.h"
#include "network.h"
#include "refine.h"

enum { FMFTS_BINS = 16, FMFTS_POSE = FMFTS_NETWORK_POSE, FMFTS_CONTACT = 3 };

/* What a contact model and a touch detector are; the model's units are mm, N, and numbers of the axis. */
#define FMFTS_CONTACT_PARAMETERS(X)                                                                                    \
    X(onset_chi2, 1)            /* touch.py */                                                                         \
    X(release_chi2, 1)                                                                                                 \
    X(release_frames, 1)                                                                                               \
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
    X(edges_m, 4)               /* of x, of y: where training ended */                                                 \
    X(spread_m, 2)                                                                                                     \
    X(force_bins, 1)                                                                                                   \
    X(force_bin_n, FMFTS_BINS)  /* upper ends of all bins but the last */                                              \
    X(radius_bins, 1)                                                                                                  \
    X(radius_bin_m, FMFTS_BINS)                                                                                        \
    X(own_deviation, 3 * FMFTS_BINS * FMFTS_BINS)                                                                      \
    X(trained_force_n, FMFTS_BINS * FMFTS_BINS)                                                                        \
    X(slipping_n, FMFTS_BINS)   /* by radius */

#define FMFTS_CONTACT_MEMORY(X)                                                                                        \
    X(touched, 1)                                                                                                      \
    X(quiet_frames, 1)

FMFTS_STRUCT(fmfts_contact_parameters, FMFTS_CONTACT_PARAMETERS)
FMFTS_STRUCT(fmfts_contact_memory, FMFTS_CONTACT_MEMORY)

/* What the contact model is asked, in its units. share: of the change of pose that it was trained on. */
typedef struct {
    double pose[FMFTS_POSE];
    double covariance[FMFTS_POSE * FMFTS_POSE];
    double share;
} fmfts_question;

/* Place (m) and force (N), and all that is published of them. doubt: Fieller's, of the force. */
typedef struct {
    double place[FMFTS_CONTACT];
    double deviation[FMFTS_CONTACT];
    double force_min_n, central_force_sd_n, doubt;
    bool over_range;
} fmfts_estimate;

/* touch.c: touched or not, into `memory`, by the change of pose [5] and its covariance [5][5]; false where that is none. */
bool fmfts_touch(const fmfts_contact_parameters *parameters, fmfts_contact_memory *memory, const double *change,
                 const double *covariance);

/* estimate.c: keeps the question inside what the model was trained on. False where the magnet is lifted. */
bool fmfts_keep_inside(const fmfts_contact_parameters *parameters, fmfts_question *question);

/* estimate.c: the network's answer, and where there is a response of the pad (NULL: none), the most likely press near
 * it. False where the answer is no number. */
bool fmfts_estimate_contact(const fmfts_contact_parameters *parameters, const fmfts_question *question,
                            const fmfts_network *network, const void *response, size_t response_bytes,
                            fmfts_estimate *estimate);

#endif
