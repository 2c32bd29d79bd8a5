/* The contact model's answer and its variance. The variance is that of the pose, carried over by the Jacobian and widened by its bend,
 * plus the model's own error, plus that of the pad's structure (tolerances.c). */
#include <math.h>
#include <string.h>

#include "estimate.h"

enum { CONTACT = FMFTS_CONTACT, POSE = FMFTS_POSE };

/* A pose or a force is over range if it is this many deviations outside the range of the training (parameters). The
 * lower bound of a force over range is the model's force less CERTAIN_DEVIATIONS. */
#define CERTAIN_DEVIATIONS 3.0
/* A magnet is lifted if it is higher than in training by so many deviations and HYSTERESIS_MM. */
#define LIFTED_DEVIATIONS 6.0
#define HYSTERESIS_MM 0.02

/* How much a model bends over the deviations of a pose. A force grows faster than the displacement. Where the true force is larger
 * than the model's answer, the slope of the answer is too small, and so is the deviation that it propagates from the
 * pose. So the mean of two slopes is used: at the answer, and at a force that is larger by BEND_DEVIATIONS. By the
 * trapezium rule this is the slope of the chord between both. Where the true force is smaller, the deviation is a
 * little too large. If the force's deviation is a smaller share of it than STRAIGHT_SHARE, the bend makes no deviation
 * larger by more than a twentieth. */
#define BEND_DEVIATIONS 3.0
#define STRAIGHT_SHARE 0.02

static const double UNIT[CONTACT] = {1e-3, 1e-3, 1.0, 1.0, 1.0}; /* mm → m; newtons stay */

static double root_of_squares(double a, double b)
{
    return sqrt(a * a + b * b);
}

/* The first bin whose upper end is not below the value. */
static int bin_of(double count, const double *upper, double value)
{
    int bin = 0;
    while (bin < (int)count - 1 && upper[bin] < value) {
        bin++;
    }
    return bin;
}

static int radius_bin(const fmfts_contact_parameters *parameters, const double *contact)
{
    return bin_of(parameters->radius_bins, parameters->radius_bin_m, root_of_squares(contact[0], contact[1]));
}

/* Whether the force is certainly above the calibrated one. Its deviation through shear does not count here. */
static bool too_hard(const fmfts_contact_parameters *parameters, const double *contact, double variance)
{
    double beyond = contact[2] - parameters->force_max_n, slipping = parameters->slipping_n[radius_bin(parameters, contact)];
    double outside = parameters->outside_deviations;
    return beyond > 0.0 && beyond * beyond > outside * outside * (variance - slipping * slipping);
}

/* The network's answer in mm and N, and its variance, carried over from the pose by the Jacobian. */
static void answer_of(const fmfts_network *network, const fmfts_question *question, fmfts_found *found)
{
    float pose[POSE], contact[CONTACT], jacobian[CONTACT * POSE];
    for (int i = 0; i < POSE; i++) {
        pose[i] = (float)question->pose[i];
    }
    fmfts_infer(network, pose, contact, jacobian);
    for (int i = 0; i < found->outputs; i++) {
        const float *row = jacobian + POSE * i;
        found->contact[i] = contact[i];
        found->variance[i] = 0.0;
        for (int k = 0; k < POSE; k++) {
            found->by_pose[POSE * i + k] = row[k];
            for (int l = 0; l < POSE; l++) {
                found->variance[i] += row[k] * question->covariance[POSE * k + l] * row[l];
            }
        }
    }
    found->touch_variance = found->variance[2];
}

/* A finger's effect on the pose depends on the press, which follows from the rest of the pose. These rounds leave a
 * hundredth of the error. */
#define KNOWN_FINGER_ROUNDS 3
/* With shear, each round leaves up to half of the error. */
#define SHEARED_ROUNDS 5

static void answer_by_probe(const fmfts_contact_parameters *parameters, const fmfts_network *network,
                            const fmfts_response *response, fmfts_question *question, fmfts_found *found)
{
    const fmfts_question asked = *question;
    for (int round = 0; round < KNOWN_FINGER_ROUNDS && found->contact[2] > 0.0; round++) {
        double press[CONTACT] = {0.0};
        memcpy(press, found->contact, sizeof(double) * (size_t)found->outputs);
        *question = asked;
        fmfts_take_known_finger(parameters, response, press, question->pose);
        answer_of(network, question, found);
    }
}

/* With shear the solved press differs from the network's: further rounds follow, from the solved press. */
static bool solve_by_probe(const fmfts_contact_parameters *parameters, const fmfts_question *asked, const fmfts_response *response,
                           fmfts_question *question, fmfts_found *found, double bend[CONTACT])
{
    int rounds = parameters->known_finger_mm2 != 0.0 ? SHEARED_ROUNDS : 1;
    for (int round = 0; round < rounds; round++) {
        if (round > 0) {
            *question = *asked;
            fmfts_take_known_finger(parameters, response, found->contact, question->pose);
        }
        if (!fmfts_solve_answer(parameters, question, response, found, round + 1 == rounds ? bend : NULL)) {
            return false;
        }
    }
    return true;
}

double fmfts_doubt(double force_n, double variance)
{
    double least_square = FMFTS_CERTAIN_FORCE_DEVIATIONS * FMFTS_CERTAIN_FORCE_DEVIATIONS * variance;
    return force_n > 0.0 && least_square < force_n * force_n ? least_square / (force_n * force_n) : 1.0;
}

/* The factor of each variance because the model bends over the pose's deviations. Where noise alone may explain the
 * force, there is no place, and the bend means nothing. */
static void bend_of(const fmfts_network *network, const fmfts_question *question, const fmfts_found *found, double bend[CONTACT])
{
    float pose[POSE], contact[CONTACT], jacobian[CONTACT * POSE];
    const double *by_force = found->by_pose + POSE * 2, *covariance = question->covariance;
    double force_n = found->contact[2], variance = found->variance[2], straight = STRAIGHT_SHARE * force_n;
    for (int i = 0; i < found->outputs; i++) {
        bend[i] = 1.0;
    }
    bool has_shear = found->outputs == CONTACT; /* its deviations are wide enough without this: model.py */
    if (has_shear || !(variance > straight * straight) || !(fmfts_doubt(force_n, variance) < 1.0)) {
        return;
    }
    double steps = BEND_DEVIATIONS / sqrt(variance);
    for (int i = 0; i < POSE; i++) {
        double along = 0.0;
        for (int k = 0; k < POSE; k++) {
            along += covariance[POSE * i + k] * by_force[k];
        }
        pose[i] = (float)(question->pose[i] + steps * along);
    }
    fmfts_infer(network, pose, contact, jacobian);
    for (int i = 0; i < found->outputs; i++) {
        double mean[POSE], bent = 0.0;
        for (int k = 0; k < POSE; k++) {
            mean[k] = 0.5 * (found->by_pose[POSE * i + k] + jacobian[POSE * i + k]);
        }
        for (int k = 0; k < POSE; k++) {
            for (int l = 0; l < POSE; l++) {
                bent += mean[k] * covariance[POSE * k + l] * mean[l];
            }
        }
        if (bent > found->variance[i]) {
            bend[i] = bent / found->variance[i];
        }
    }
}

void fmfts_keep_inside(const fmfts_contact_parameters *parameters, fmfts_question *question)
{
    double slack[6];
    question->share = 1.0;
    for (int i = 0; i < 6; i++) {
        slack[i] = parameters->outside_deviations * sqrt(fmax(question->covariance[7 * i], 0.0));
        double moved = question->pose[i] - parameters->model_rest[i];
        double edge = moved > 0.0 ? parameters->highest[i] + slack[i] : parameters->lowest[i] - slack[i];
        if (fabs(moved) > 1e-9) {
            question->share = fmin(question->share, (edge - parameters->model_rest[i]) / moved);
        }
    }
    double certain = LIFTED_DEVIATIONS * slack[2] / parameters->outside_deviations;
    question->lifted_m = fmax(question->pose[2] - parameters->trained_top_mm - HYSTERESIS_MM - certain, 0.0) * 1e-3;
    question->pose[2] = fmin(question->pose[2], parameters->trained_top_mm);
    if (question->share < 1.0) {
        for (int i = 0; i < 6; i++) {
            question->pose[i] = parameters->model_rest[i] + question->share * (question->pose[i] - parameters->model_rest[i]);
        }
        for (int i = 0; i < 36; i++) {
            question->covariance[i] *= question->share * question->share;
        }
    }
}

/* The probability that a place is far from the true one: the doubt of its force, to the power of 2.5. */
static double astray_share(double doubt)
{
    return doubt * doubt * sqrt(doubt);
}

static int bin_in_tables(const fmfts_contact_parameters *parameters, const double *contact, int radius_bin)
{
    int force_bin = bin_of(parameters->force_bins, parameters->force_bin_n, contact[2]);
    return force_bin * (int)parameters->radius_bins + radius_bin;
}

/* The deviation of the same force in the middle of the pad: without a touch there is no place whose errors could count. */
static double central_force_sd_n(const fmfts_contact_parameters *parameters, const double *contact, const fmfts_found *found)
{
    int bin = bin_in_tables(parameters, contact, 0);
    return root_of_squares(sqrt(found->touch_variance), parameters->own_deviation[found->outputs * bin + 2]);
}

/* Whether the place is outside of the calibrated places along one axis. */
static bool is_beyond_edge(const fmfts_contact_parameters *parameters, const double *contact, int axis)
{
    return contact[axis] < parameters->edges_m[2 * axis] || contact[axis] > parameters->edges_m[2 * axis + 1];
}

/* Whether every calibrated place is nearer to the middle: the model's slopes are then small, and its deviations, too. */
static bool is_beyond_corner(const fmfts_contact_parameters *parameters, const double *contact)
{
    const double *edge = parameters->edges_m;
    double corner_m = root_of_squares(fmax(-edge[0], edge[1]), fmax(-edge[2], edge[3]));
    return root_of_squares(contact[0], contact[1]) > corner_m;
}

/* The variance in SI: the pose's, the model's own error, and the structure's. That of a place is at most that of a place on the pad. */
static void spread_of(const fmfts_contact_parameters *parameters, const double *contact, const fmfts_found *answer,
                      const double *bend, const double *structure, double variance[CONTACT])
{
    const double *found = answer->variance;
    int bin = bin_in_tables(parameters, contact, radius_bin(parameters, contact));
    const double *own = parameters->own_deviation + answer->outputs * bin;
    for (int i = 0; i < answer->outputs; i++) {
        variance[i] = (found[i] * bend[i] + structure[i]) * UNIT[i] * UNIT[i] + own[i] * own[i];
        variance[i] += i < 2 ? parameters->magnet_off_m[i] * parameters->magnet_off_m[i] : 0.0;
    }
    double certain = 1.0 - fmfts_doubt(contact[2], answer->touch_variance);
    double trained = answer->touch_variance + parameters->trained_force_n[bin] * parameters->trained_force_n[bin];
    double astray = certain * astray_share(fmfts_doubt(contact[2], trained));
    for (int i = 0; i < 2; i++) {
        double even = parameters->spread_m[i] * parameters->spread_m[i];
        double ratio = variance[i] + astray * even;
        bool is_beyond = is_beyond_edge(parameters, contact, i) || is_beyond_corner(parameters, contact);
        variance[i] = is_beyond ? even : ratio * even / fmax(ratio, certain * even);
    }
}

bool fmfts_estimate_contact(const fmfts_contact_parameters *parameters, const fmfts_question *asked,
                            const fmfts_network *network, const void *response, size_t response_bytes,
                            fmfts_estimate *estimate)
{
    fmfts_found found = {.outputs = (int)network->outputs, .by_pose = estimate->by_pose};
    fmfts_response table;
    double variance[FMFTS_CONTACT], bend[FMFTS_CONTACT] = {1.0, 1.0, 1.0, 1.0, 1.0}, structure[FMFTS_CONTACT];
    double *place = estimate->place, limit = parameters->force_max_n;
    fmfts_question by_probe = *asked, *question = &by_probe;
    bool has_table = response && fmfts_view_response(response, response_bytes, &table);
    answer_of(network, question, &found);
    if (has_table && parameters->known_finger_mm2 != 0.0) {
        answer_by_probe(parameters, network, &table, question, &found);
    }
    bool solves = parameters->shear_share > 0.0, refines = !solves && response && parameters->refine_steps > 0.0;
    if (!solves) {
        bend_of(network, question, &found, bend);
    }
    if ((refines && !(has_table && fmfts_refine_answer(parameters, question, &table, &found, bend))) ||
        (solves && !(has_table && solve_by_probe(parameters, asked, &table, question, &found, bend)))) {
        return false;
    }
    estimate->lowered_chi2 = 0.0;
    estimate->explained = has_table ? fmfts_explained_part(parameters, question, &table, &found, &estimate->lowered_chi2) : 1.0;
    estimate->is_beyond = question->share < 1.0 || found.contact[2] > limit;
    fmfts_answer answer = {found.outputs, found.contact, found.by_pose};
    fmfts_count_tolerances(parameters, has_table ? &table : NULL, question, &answer, structure);
    for (int i = 0; i < found.outputs; i++) {
        place[i] = found.contact[i] * UNIT[i];
    }
    spread_of(parameters, place, &found, bend, structure, variance);
    double own_variance = variance[2] - structure[2]; /* an error of scale causes neither a touch nor over range */
    estimate->outputs = found.outputs;
    estimate->refused = network->outputs == CONTACT && (is_beyond_edge(parameters, place, 0) || is_beyond_edge(parameters, place, 1));
    for (int i = 0; i < found.outputs; i++) {
        estimate->deviation[i] = sqrt(variance[i]);
    }
    estimate->over_range = question->share < 1.0 || too_hard(parameters, place, own_variance);
    estimate->force_min_n = fmax(fmin(place[2], limit) - CERTAIN_DEVIATIONS * estimate->deviation[2], 0.0);
    estimate->central_force_sd_n = central_force_sd_n(parameters, place, &found);
    double touch_variance = own_variance - (found.variance[2] * bend[2] - found.touch_variance) * (solves ? 1.0 : 0.0);
    estimate->pose_force_sd_n = sqrt(found.touch_variance);
    estimate->own_force_sd_n = sqrt(touch_variance);
    estimate->doubt = fmfts_doubt(place[2], touch_variance);
    return isfinite(place[2]);
}
