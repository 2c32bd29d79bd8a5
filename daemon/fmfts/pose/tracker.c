/* The magnet's state from a field and the state before: Tracker._follow for a frame that fits. */
#include <math.h>
#include <string.h>

#include "model.h"
#include "solver.h"
#include "step.h"

/* since_good_s of tracker.py: the frame before was healthy, too. */
static double elapsed_s(const fmfts_pose_memory *memory, const fmfts_field *field)
{
    return fmax(field->instant_us - memory->last_us[0], 0.0) * 1e-6;
}

/* Makes the last state the prior of this frame: Tracker._predicted. */
static void predict(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, double elapsed, double temperature_c)
{
    for (int c = 0; c < FMFTS_STEP; c++) {
        memory->covariance[c * FMFTS_STEP + c] += parameters->walk_per_s[c] * elapsed;
    }
    double warmer_k = temperature_c - parameters->rest_temperature_c[0];
    if (!isfinite(warmer_k)) {
        return;
    }
    double warmth = parameters->moment_per_k_deviation[0] * warmer_k;
    memory->covariance[LOG_COLUMN * FMFTS_STEP + LOG_COLUMN] += fmax(warmth * warmth - memory->warmth_variance[0], 0.0);
    memory->warmth_variance[0] = fmax(warmth * warmth, memory->warmth_variance[0]);
    if (parameters->part[LOG_COLUMN] == FMFTS_CONSIDERED) {
        memory->state[LOG_VALUE] = parameters->rest[LOG_VALUE] + parameters->moment_per_k[0] * warmer_k;
    }
}

static void write_measurements(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const fmfts_field *field,
                               double *rows)
{
    for (int axis = 0; axis < 3 * (int)parameters->sensors[0]; axis++) {
        double *row = rows + FMFTS_MEASUREMENT * axis;
        memcpy(row, parameters->place_m + axis / 3 * 3, 3 * sizeof(double));
        memcpy(row + 3, parameters->direction + 3 * axis, 3 * sizeof(double));
        row[6] = axis / 3 == (int)memory->blamed[0] ? NAN : field->field_t[axis]; /* the solver leaves NaN out */
        row[7] = sqrt(field->variance_t2[axis]);
        row[8] = row[9] = 0.0;
    }
}

/* Degrees of freedom: the values that were measured, without the unknowns. */
static int freedom_of(const fmfts_pose_parameters *parameters, const fmfts_summary *found)
{
    return (int)found->rows - (int)parameters->unknowns[0];
}

static bool fits(const fmfts_pose_parameters *parameters, const fmfts_summary *found, const double *state, const double *covariance)
{
    int freedom = freedom_of(parameters, found);
    double square = 0.0, trace = 0.0, stronger = state[LOG_VALUE] - parameters->rest[LOG_VALUE];
    for (int i = 0; i < 3; i++) {
        square += (state[i] - parameters->rest[i]) * (state[i] - parameters->rest[i]);
        trace += covariance[(FMFTS_STEP + 1) * i];
    }
    return found->status == FMFTS_CONVERGED && sqrt(square) < parameters->reach_m[0] &&
           trace < parameters->vague_m[0] * parameters->vague_m[0] &&
           stronger > -parameters->log_moment_reach[0] && stronger < parameters->strongest[0] &&
           freedom > 0 && found->chi2 < parameters->gate_chi2[freedom];
}

enum { MOST_MAGNETS = 1 + FMFTS_NEIGHBOURS };

/* The pad's own magnet and its neighbours as one problem: `joined` of neighbour.py. */
typedef struct {
    double magnet[FMFTS_MAGNET * MOST_MAGNETS], state[FMFTS_VALUES(MOST_MAGNETS)];
    double covariance[FMFTS_COLUMNS(MOST_MAGNETS) * FMFTS_COLUMNS(MOST_MAGNETS)];
    uint8_t part[FMFTS_COLUMNS(MOST_MAGNETS)];
} joined_problem;

static void join(const fmfts_pose_parameters *parameters, const fmfts_pose_memory *memory, const fmfts_felt *felt,
                 joined_problem *joined)
{
    size_t columns = FMFTS_COLUMNS(1 + felt->count);
    joined->magnet[0] = parameters->strength_t_m3[0];
    joined->magnet[1] = parameters->octupole_m2[0];
    memcpy(joined->magnet + FMFTS_MAGNET, felt->magnet, felt->count * sizeof felt->magnet[0]);
    memcpy(joined->state, memory->state, sizeof memory->state);
    memcpy(joined->state + FMFTS_STATE, felt->now, felt->count * sizeof felt->now[0]);
    memset(joined->covariance, 0, columns * columns * sizeof joined->covariance[0]);
    for (size_t c = 0; c < FMFTS_STEP; c++) {
        joined->part[c] = (uint8_t)parameters->part[c];
        memcpy(joined->covariance + columns * c, memory->covariance + FMFTS_STEP * c, FMFTS_STEP * sizeof(double));
    }
    for (size_t n = 0; n < felt->count; n++) {
        for (size_t c = first_column(1 + n), i = 0; i < FMFTS_MOVES; i++) {
            joined->part[c + i] = FMFTS_PRIOR;
            memcpy(joined->covariance + columns * (c + i) + c, felt->covariance[n][i], sizeof felt->covariance[n][i]);
        }
    }
}

bool fmfts_track(const fmfts_pose_parameters *parameters, fmfts_pose_memory *memory, const fmfts_felt *felt, fmfts_field *field,
                 double temperature_c, fmfts_pose *pose)
{
    double rows[FMFTS_AXES * FMFTS_MEASUREMENT], work[FMFTS_WORK(FMFTS_AXES)], state[FMFTS_VALUES(MOST_MAGNETS)],
        covariance[FMFTS_COLUMNS(MOST_MAGNETS) * FMFTS_COLUMNS(MOST_MAGNETS)], direction[FMFTS_COLUMNS(MOST_MAGNETS)],
        placed[FMFTS_NEIGHBOURS][FMFTS_PLACED];
    bool has_prior = felt->count > 0;
    size_t columns = FMFTS_COLUMNS(1 + felt->count);
    joined_problem joined;
    double elapsed = elapsed_s(memory, field);
    predict(parameters, memory, elapsed, temperature_c);
    write_measurements(parameters, memory, field, rows);
    join(parameters, memory, felt, &joined);
    for (int c = 0; c < FMFTS_STEP; c++) {
        has_prior |= joined.part[c] == FMFTS_PRIOR || joined.part[c] == FMFTS_CONSIDERED;
    }
    const fmfts_problem problem = {
        .measurements = rows,
        .rows = 3 * (size_t)parameters->sensors[0],
        .magnets = joined.magnet,
        .magnet_count = 1 + felt->count,
        .parts = joined.part,
        .start = joined.state,
        .prior_mean = has_prior ? joined.state : NULL,
        .prior_covariance = has_prior ? joined.covariance : NULL,
        .stop_chi2 = parameters->stop_chi2[0],
        .max_iterations = (int)parameters->max_iterations[0],
    };
    fmfts_summary found = fmfts_solve(&problem, work, state, covariance, direction);
    for (size_t c = 0; c < FMFTS_STEP; c++) {
        memcpy(pose->covariance + FMFTS_STEP * c, covariance + columns * c, FMFTS_STEP * sizeof(double));
    }
    if (!fits(parameters, &found, state, pose->covariance)) {
        return false;
    }
    pose->chi2 = found.chi2;
    pose->residual_t = found.residual_t;
    pose->elapsed_s = elapsed;
    memcpy(memory->state, state, sizeof memory->state);
    memcpy(memory->covariance, pose->covariance, sizeof memory->covariance);
    memcpy(placed, state + FMFTS_STATE, felt->count * sizeof placed[0]);
    fmfts_take_neighbours(parameters, felt, (const double(*)[FMFTS_PLACED])placed, field);
    memory->misfit[0] += (found.chi2 / freedom_of(parameters, &found) - memory->misfit[0]) / parameters->misfit_frames[0];
    double misfit = fmax(memory->misfit[0], memory->lasting_misfit[0]);
    for (int i = 0; i < FMFTS_STEP * FMFTS_STEP; i++) {
        pose->covariance[i] *= misfit;
    }
    memory->last_us[0] = field->instant_us;
    memory->passed[0] += 1.0;
    return true;
}
