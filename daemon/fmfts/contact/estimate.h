/* A contact model's answer before its deviations are whole: estimate.c and refined.c. */
#ifndef FMFTS_ESTIMATE_H
#define FMFTS_ESTIMATE_H

#include "step.h"

/* In the model's units. by_pose [CONTACT][POSE]: the derivative of the answer by the pose. touch_variance: the part of
 * the force's variance that makes a touch doubtful; an unknown shear does not. */
typedef struct {
    int outputs;
    double contact[FMFTS_CONTACT];
    double variance[FMFTS_CONTACT], touch_variance;
    double *by_pose;
    bool solved; /* an earlier round found a press */
} fmfts_found;

/* estimate.c: from 0 to 1, how well noise of this variance alone explains the force: g of Fieller's theorem. A place is
 * a ratio: how far the magnet tilts and shifts, over how far it sinks. The deviation of such a ratio grows by 1/sqrt(1
 * - g). */
double fmfts_doubt(double force_n, double variance);

/* refined.c: the share of the movement that a press explains, and by how much that lowers χ² (0 with shear, which would explain any
 * movement). Computed only if the magnet has moved, or the force is large enough for a contact. */
double fmfts_explained_part(const fmfts_contact_parameters *parameters, const fmfts_question *question, const fmfts_response *response,
                            const fmfts_found *found, double *lowered_chi2);

/* refined.c: replaces the answer by the most likely press of the pad's response, and widens its bend. False if there is none. */
bool fmfts_refine_answer(const fmfts_contact_parameters *parameters, const fmfts_question *question, const fmfts_response *response,
                         fmfts_found *found, double bend[FMFTS_CONTACT]);

/* refined.c: solves place, force and shear together (sheared.c), from the network's answer, which knows no shear.
 * bend: NULL if another round follows. False if there is no answer. */
bool fmfts_solve_answer(const fmfts_contact_parameters *parameters, const fmfts_question *question, const fmfts_response *response,
                        fmfts_found *found, double bend[FMFTS_CONTACT]);

#endif
