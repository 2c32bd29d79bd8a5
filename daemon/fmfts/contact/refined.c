#include <math.h>
#include <string.h>

#include "estimate.h"

enum { CONTACT = FMFTS_CONTACT, POSE = FMFTS_POSE };

/* If a refined place is known no better than this, another press may explain the pose as well: the force at the rim is three times that
 * in the middle. */
#define VAGUE_MM 1.0

/* Of the search for a press with shear. A friction of 0.8 puts the network's answer up to ten deviations away. */
enum { SHEAR_STEPS = 16 };
#define SETTLED_DEVIATIONS 0.1

/* The change of pose from rest, and its covariance, as the table of presses has them. */
static void movement_of(const fmfts_contact_parameters *parameters, const fmfts_question *question, double moved[FMFTS_MOVED],
                        double covariance[FMFTS_MOVED * FMFTS_MOVED])
{
    for (int i = 0; i < FMFTS_MOVED; i++) {
        moved[i] = question->pose[i] - parameters->model_rest[i];
        for (int j = 0; j < FMFTS_MOVED; j++) {
            covariance[FMFTS_MOVED * i + j] = question->covariance[POSE * i + j] + (i == j ? parameters->least_variance : 0.0);
        }
    }
}

/* Whether the magnet moved further than noise moves it. Shear outwards on the rim hides force, but not this. */
static bool has_moved(const fmfts_contact_parameters *parameters, const double moved[FMFTS_MOVED], const double *covariance)
{
    double chi2, onset = parameters->onset_chi2; /* 0: outside of a pipeline */
    return onset > 0.0 && fmfts_chi2_from_rest(FMFTS_MOVED, moved, covariance, &chi2) && chi2 > onset;
}

double fmfts_explained_part(const fmfts_contact_parameters *parameters, const fmfts_question *question, const fmfts_response *response,
                            const fmfts_found *found, double *lowered_chi2)
{
    double moved[FMFTS_MOVED], covariance[FMFTS_MOVED * FMFTS_MOVED], force_n = found->contact[2];
    *lowered_chi2 = 0.0;
    if ((int)response->loads != found->outputs - 2 || !(force_n > 0.0)) {
        return 1.0;
    }
    movement_of(parameters, question, moved, covariance);
    if (!(force_n * force_n > found->variance[2]) && !has_moved(parameters, moved, covariance)) {
        return 1.0;
    }
    fmfts_press_search search = {.change = moved, .covariance = covariance, .shear_share = parameters->shear_share};
    double share = fmfts_explained_share(response, &search, found->contact, FMFTS_EXPLAINED_SHARE, lowered_chi2);
    if (found->outputs == CONTACT) {
        *lowered_chi2 = 0.0;
    }
    return share;
}

bool fmfts_refine_answer(const fmfts_contact_parameters *parameters, const fmfts_question *question,
                   const fmfts_response *response, fmfts_found *found, double bend[CONTACT])
{
    double moved[FMFTS_MOVED], covariance[FMFTS_MOVED * FMFTS_MOVED], spread[CONTACT * CONTACT], chi2;
    int outputs = found->outputs;
    if ((int)response->loads != outputs - 2) {
        return false;
    }
    movement_of(parameters, question, moved, covariance);
    fmfts_press_search search = {.change = moved, .covariance = covariance, .steps = (int)parameters->refine_steps};
    if (!fmfts_refine(response, &search, found->contact, spread, &chi2)) {
        return false;
    }
    double vague = VAGUE_MM * VAGUE_MM, force_n = found->contact[2], wider[CONTACT] = {1.0, 1.0, 1.0, 1.0, 1.0};
    bool has_place = force_n * force_n > spread[(outputs + 1) * 2];
    if (outputs < CONTACT && has_place && (spread[0] > vague || spread[outputs + 1] > vague)) {
        fmfts_look_elsewhere(response, moved, covariance, found->contact, spread, wider);
    }
    for (int i = 0; i < outputs; i++) {
        found->variance[i] = spread[(outputs + 1) * i];
        bend[i] = fmax(bend[i], wider[i]);
    }
    found->touch_variance = found->variance[2];
    return true;
}

/* A touch that noise alone could explain: the answer without shear, and shear within the cone of friction. */
static void suppose_shear(const fmfts_contact_parameters *parameters, fmfts_found *found)
{
    double largest_n = fmax(found->contact[2], 0.0) + sqrt(found->variance[2]);
    for (int i = found->outputs; i < CONTACT; i++) {
        found->contact[i] = 0.0;
        found->variance[i] = parameters->shear_share * parameters->shear_share * largest_n * largest_n;
        memset(found->by_pose + POSE * i, 0, sizeof(double[POSE]));
    }
    found->outputs = CONTACT;
}

bool fmfts_solve_answer(const fmfts_contact_parameters *parameters, const fmfts_question *question,
                        const fmfts_response *response, fmfts_found *found, double bend[CONTACT])
{
    double moved[FMFTS_MOVED], covariance[FMFTS_MOVED * FMFTS_MOVED];
    fmfts_press_search search = {moved, covariance, SHEAR_STEPS, SETTLED_DEVIATIONS, parameters->shear_share, false};
    bool may_be_noise = !found->solved && !(fmfts_doubt(found->contact[2], found->variance[2]) < 1.0);
    double begun_n = found->contact[2];
    fmfts_sheared solved;
    movement_of(parameters, question, moved, covariance);
    suppose_shear(parameters, found);
    if (may_be_noise && !(begun_n > 0.0 && has_moved(parameters, moved, covariance))) {
        return true;
    }
    memcpy(solved.press, found->contact, sizeof solved.press);
    if (!fmfts_solve_shear(response, &search, bend != NULL, &solved)) {
        return false;
    }
    double share = begun_n > 0.0 ? solved.press[2] / begun_n : 0.0; /* a later round may begin without force */
    found->solved = true;
    found->touch_variance *= share * share; /* as certain a touch as without shear */
    memcpy(found->contact, solved.press, sizeof solved.press);
    memcpy(found->variance, solved.variance, sizeof solved.variance);
    if (bend) {
        memcpy(bend, solved.bend, sizeof solved.bend);
    }
    for (int i = 0; i < CONTACT; i++) {
        memcpy(found->by_pose + POSE * i, solved.gain[i], sizeof solved.gain[i]);
        found->by_pose[POSE * i + FMFTS_MOVED] = 0.0;
    }
    return true;
}
