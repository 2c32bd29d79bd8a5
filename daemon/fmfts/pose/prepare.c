/* Checks the input of a solve, and prepares it for the search. */
#include <string.h>

#include "search.h"

#define UNIT 1e-6 /* the length of a unit vector may differ from one by this */

static bool all_finite(const double *values, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(values[i])) {
            return false;
        }
    }
    return true;
}

static bool is_unit(const double *vector)
{
    return fabs(sqrt(dot3(vector, vector)) - 1.0) <= UNIT;
}

static bool valid_state(const fmfts_problem *problem, const double *state)
{
    if (!all_finite(state, FMFTS_VALUES(problem->magnet_count))) {
        return false;
    }
    for (size_t m = 0; m < problem->magnet_count; m++) {
        const uint8_t *tilt = problem->parts + first_column(m) + TILT_COLUMN;
        if (!is_unit(state + first_value(m) + AXIS_VALUE) || tilt[0] != tilt[1]) {
            return false;
        }
    }
    return true;
}

/* Whether each column has a known part, a finite rate, and a finite diffusion that is not negative. */
static bool valid_columns(const fmfts_problem *problem)
{
    for (size_t c = 0; c < FMFTS_COLUMNS(problem->magnet_count); c++) {
        bool moves = !problem->rate || isfinite(problem->rate[c]);
        bool spreads = !problem->diffusion || (problem->diffusion[c] >= 0.0 && isfinite(problem->diffusion[c]));
        if (problem->parts[c] > FMFTS_PRIOR || !moves || !spreads) {
            return false;
        }
    }
    return true;
}

bool fmfts_valid(const fmfts_problem *problem)
{
    if (problem->magnet_count < 1 || problem->magnet_count > FMFTS_MAX_MAGNETS || !valid_columns(problem)) {
        return false;
    }
    if (!(problem->stop_chi2 > 0.0) || !isfinite(problem->stop_chi2)) {
        return false;
    }
    if (!all_finite(problem->magnets, FMFTS_MAGNET * problem->magnet_count)) {
        return false;
    }
    for (size_t m = 0; m < problem->magnet_count; m++) {
        if (!(problem->magnets[FMFTS_MAGNET * m] > 0.0)) {
            return false;
        }
    }
    return valid_state(problem, problem->start) && (!problem->prior_mean || valid_state(problem, problem->prior_mean));
}

/* Extrapolates a sample that is `age` seconds old to the state's time, linear about the start: the known rate moves the
 * value, and diffusion adds to the variance. */
static void bring_to_now(const fmfts_pose_search *search, const double *place, const double *direction, double age,
                         double *value, double *variance)
{
    const fmfts_problem *problem = search->problem;
    double column[FMFTS_MAX_COLUMNS] = {0};
    fmfts_sight sight[FMFTS_MAX_MAGNETS];
    look_all(&search->sources, place, sight);
    sense_all(&search->sources, sight, problem->start, place, direction, column);
    for (size_t c = 0; c < search->columns; c++) {
        *value += problem->rate ? age * column[c] * problem->rate[c] : 0.0;
        *variance += problem->diffusion ? age * column[c] * column[c] * problem->diffusion[c] : 0.0;
    }
}

bool fmfts_prepare_rows(fmfts_pose_search *search, fmfts_row *rows)
{
    const fmfts_problem *problem = search->problem;
    size_t count = 0;
    for (size_t i = 0; i < problem->rows; i++) {
        const double *from = problem->measurements + FMFTS_MEASUREMENT * i;
        double value = from[6], noise = from[7], proportional = from[8];
        if (!isfinite(value) || noise == INFINITY) {
            continue;
        }
        fmfts_row *row = &rows[count];
        memcpy(row->place, from, sizeof row->place);
        memcpy(row->direction, from + 3, sizeof row->direction);
        bool measured = noise > 0.0 && proportional >= 0.0 && from[9] >= 0.0;
        if (!measured || !all_finite(from, FMFTS_MEASUREMENT) || !is_unit(row->direction)) {
            return false;
        }
        double variance = noise * noise + proportional * proportional * value * value;
        if (problem->rate || problem->diffusion) {
            bring_to_now(search, row->place, row->direction, from[9], &value, &variance);
        }
        if (!(variance > 0.0) || !isfinite(variance)) {
            return false; /* the variance is beyond the range of a double */
        }
        row->deviation = sqrt(variance);
        double weight = 1.0 / row->deviation;
        for (int axis = 0; axis < 3; axis++) {
            row->direction[axis] *= weight;
        }
        row->value = value * weight;
        const double *before = count ? rows[count - 1].place : NULL;
        row->shares_place =
            before && before[0] == row->place[0] && before[1] == row->place[1] && before[2] == row->place[2];
        count++;
    }
    search->rows = rows;
    search->row_count = count;
    return true;
}

bool fmfts_prepare_columns(fmfts_pose_search *search, fmfts_matrix work)
{
    const fmfts_problem *problem = search->problem;
    const uint8_t *parts = problem->parts;
    size_t held[FMFTS_MAX_COLUMNS], held_count = 0;
    for (size_t c = 0; c < search->columns; c++) {
        if (fmfts_estimated(parts[c])) {
            search->order[search->ordered++] = c;
        }
    }
    search->active = search->ordered;
    for (size_t c = 0; c < search->columns; c++) {
        if (parts[c] == FMFTS_CONSIDERED) {
            search->order[search->ordered++] = c;
        }
    }
    for (size_t i = 0; i < search->ordered; i++) {
        if (parts[search->order[i]] != FMFTS_FREE) {
            held[held_count++] = i;
        }
    }
    search->sources.with_gradient = false;
    for (size_t i = 0; i < 5; i++) {
        search->sources.with_gradient |= parts[GRADIENT_COLUMN + i] != FMFTS_FIXED || problem->start[GRADIENT_VALUE + i] != 0.0;
    }
    search->has_prior = held_count > 0;
    if (!search->has_prior) {
        return true;
    }
    if (!problem->prior_mean || !problem->prior_covariance) {
        return false;
    }
    fmfts_matrix block;
    for (size_t i = 0; i < held_count; i++) {
        for (size_t j = 0; j < held_count; j++) {
            size_t row = search->order[held[i]], column = search->order[held[j]];
            block[i][j] = problem->prior_covariance[row * search->columns + column];
        }
    }
    if (!factor(held_count, block, 0.0, work)) {
        return false;
    }
    invert_factored(held_count, work, block);
    for (size_t i = 0; i < search->ordered; i++) {
        memset(search->information[i], 0, search->ordered * sizeof(double));
    }
    for (size_t i = 0; i < held_count; i++) {
        for (size_t j = 0; j < held_count; j++) {
            search->information[held[i]][held[j]] = block[i][j];
        }
    }
    return true;
}
