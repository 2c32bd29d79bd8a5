/* The contact model's answer with its covariance, and what is said of it: ContactModel._contact, contact_message.py. */
#include <math.h>

#include "../pipeline/fast/tables.h"

enum { CONTACT = 3, POSE = 6 };
static const double UNIT[CONTACT] = {1e-3, 1e-3, 1.0}; /* mm → m; newtons stay */

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

static int radius_bin(const fmfts_facts *facts, const double *contact)
{
    return bin_of(facts->radius_bins[0], facts->radius_bin_m, root_of_squares(contact[0], contact[1]));
}

/* ContactModel._too_hard */
static bool too_hard(const fmfts_facts *facts, const double *contact, double variance)
{
    double beyond = contact[2] - facts->force_max_n[0], slipping = facts->slipping_n[radius_bin(facts, contact)];
    double outside = facts->outside_deviations[0];
    return beyond > 0.0 && beyond * beyond > outside * outside * (variance - slipping * slipping);
}

void fmfts_take_answer(const fmfts_question *question, const float *contact, const float *jacobian, fmfts_found *found)
{
    for (int i = 0; i < CONTACT; i++) {
        const float *row = jacobian + POSE * i;
        found->contact[i] = contact[i];
        found->variance[i] = 0.0;
        for (int k = 0; k < POSE; k++) {
            for (int l = 0; l < POSE; l++) {
                found->variance[i] += row[k] * question->covariance[POSE * k + l] * row[l];
            }
        }
    }
}

bool fmfts_refine_answer(const fmfts_facts *facts, const fmfts_question *question, const fmfts_response *response,
                         fmfts_found *found)
{
    double moved[FMFTS_MOVED], covariance[FMFTS_MOVED * FMFTS_MOVED], spread[CONTACT * CONTACT];
    if (response->loads != CONTACT - 2) {
        return false;
    }
    for (int i = 0; i < FMFTS_MOVED; i++) {
        moved[i] = question->pose[i] - facts->model_rest[i];
        for (int j = 0; j < FMFTS_MOVED; j++) {
            covariance[FMFTS_MOVED * i + j] =
                question->covariance[POSE * i + j] + (i == j ? facts->least_variance[0] : 0.0);
        }
    }
    if (!fmfts_refine(response, moved, covariance, (int)facts->refine_steps[0], found->contact, spread)) {
        return false;
    }
    for (int i = 0; i < CONTACT; i++) {
        found->variance[i] = spread[(CONTACT + 1) * i];
    }
    return true;
}

/* Fieller's theorem: model.py. */
static double doubt(const fmfts_facts *facts, double force_n, double variance)
{
    double least = facts->certain_force_deviations[0] * facts->certain_force_deviations[0] * variance;
    return force_n > 0.0 && least < force_n * force_n ? least / (force_n * force_n) : 1.0;
}

/* astray_share of model.py */
static double astray_share(double doubt)
{
    return doubt * doubt * sqrt(doubt);
}

static int bin_in_tables(const fmfts_facts *facts, const double *contact, int radius_bin)
{
    int force_bin = bin_of(facts->force_bins[0], facts->force_bin_n, contact[2]);
    return force_bin * (int)facts->radius_bins[0] + radius_bin;
}

/* ContactEstimate.central_force_sd_n */
static double central_force_sd_n(const fmfts_facts *facts, const double *contact, const double *found)
{
    return root_of_squares(sqrt(found[2]), facts->own_deviation[CONTACT * bin_in_tables(facts, contact, 0) + 2]);
}

/* The pose's share of the variance, and the model's own error; a place is on the pad anyway. */
static void spread_of(const fmfts_facts *facts, const double *contact, const double *found, double variance[CONTACT])
{
    int bin = bin_in_tables(facts, contact, radius_bin(facts, contact));
    const double *own = facts->own_deviation + CONTACT * bin;
    for (int i = 0; i < CONTACT; i++) {
        variance[i] = found[i] * UNIT[i] * UNIT[i] + own[i] * own[i];
    }
    double certain = 1.0 - doubt(facts, contact[2], found[2]);
    double trained = found[2] + facts->trained_force_n[bin] * facts->trained_force_n[bin];
    double astray = certain * astray_share(doubt(facts, contact[2], trained));
    for (int i = 0; i < 2; i++) {
        double even = facts->spread_m[i] * facts->spread_m[i];
        bool beyond = contact[i] < facts->edges_m[2 * i] || contact[i] > facts->edges_m[2 * i + 1];
        double ratio = variance[i] + astray * even;
        variance[i] = beyond ? even : ratio * even / fmax(ratio, certain * even);
    }
}

/* contact_message.py */
static double quiet_force_sd_n(double force_sd_n, double unfelt_n)
{
    return root_of_squares(force_sd_n, unfelt_n / sqrt(3.0));
}

static bool all_numbers(const fmfts_numbers *numbers, bool with_temperature, bool with_ambient)
{
    double sum = with_temperature ? numbers->temperature_c[0] : 0.0;
    const double *first = numbers->x_m, *ambient = numbers->ambient_t, *last = (const double *)(numbers + 1);
    for (const double *number = first; number < last; number++) {
        sum += with_ambient || number < ambient || number >= numbers->residual_t ? *number : 0.0;
    }
    return isfinite(sum);
}

fmfts_contact fmfts_answer(const fmfts_facts *facts, const fmfts_question *question, const fmfts_found *found,
                           fmfts_numbers *numbers)
{
    double place[CONTACT], variance[CONTACT], limit = facts->force_max_n[0];
    for (int i = 0; i < CONTACT; i++) {
        place[i] = found->contact[i] * UNIT[i];
    }
    spread_of(facts, place, found->variance, variance);
    double force_sd = sqrt(variance[2]);
    bool over_range = question->share < 1.0 || too_hard(facts, place, variance[2]);
    numbers->x_m[0] = place[0];
    numbers->x_sd_m[0] = sqrt(variance[0]);
    numbers->y_m[0] = place[1];
    numbers->y_sd_m[0] = sqrt(variance[1]);
    numbers->force_n[0] = fmax(place[2], 0.0);
    numbers->force_sd_n[0] = force_sd;
    numbers->force_min_n[0] = fmax(fmin(place[2], limit) - facts->certain_deviations[0] * force_sd, 0.0);
    if (!isfinite(place[2]) || !all_numbers(numbers, !isnan(numbers->temperature_c[0]), !isnan(facts->ambient_t[0]))) {
        return FMFTS_NO_NUMBER;
    }
    double unfelt_n = facts->unfelt_n[0];
    if (question->touching == 0.0) {
        numbers->force_sd_n[0] = quiet_force_sd_n(central_force_sd_n(facts, place, found->variance), unfelt_n);
        return FMFTS_QUIET;
    }
    numbers->force_sd_n[0] = quiet_force_sd_n(force_sd, doubt(facts, place[2], variance[2]) * unfelt_n);
    return over_range ? FMFTS_OVER_RANGE : FMFTS_TOUCHED;
}
