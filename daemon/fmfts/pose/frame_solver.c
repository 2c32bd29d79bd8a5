/* The most likely state of one frame, from the prior and the measured field. */
#include <string.h>

#include "foreign_field.h"
#include "model.h"
#include "tracking.h"

/* Solve to a thousandth of a deviation: before rest is recorded, deviations include the mounting's tolerances (0.4 mm). */
static const double STOP_CHI2 = 1e-6;

/* The pad's own magnet and its neighbours as one problem. A neighbour's prior is where its own pad saw it last. */
typedef struct {
    double measurements[FMFTS_AXES * FMFTS_MEASUREMENT];
    double magnets[FMFTS_MAGNET * FMFTS_MAX_MAGNETS];
    uint8_t parts[FMFTS_MAX_COLUMNS];
    double mean[FMFTS_VALUES(FMFTS_MAX_MAGNETS)], start[FMFTS_VALUES(FMFTS_MAX_MAGNETS)];
    double covariance[FMFTS_MAX_COLUMNS * FMFTS_MAX_COLUMNS];
    size_t columns;
    bool has_prior;
} frame_problem;

void fmfts_write_measurements(const fmfts_step *step, const double *field_t, double *row)
{
    const fmfts_pose_parameters *parameters = step->parameters;
    for (int axis = 0; axis < 3 * (int)parameters->sensors; axis++, row += FMFTS_MEASUREMENT) {
        memcpy(row, parameters->place_m + axis / 3 * 3, 3 * sizeof(double));
        memcpy(row + 3, parameters->direction + 3 * axis, 3 * sizeof(double));
        row[6] = field_t[axis];
        row[7] = sqrt(step->field.variance_t2[axis]);
        row[8] = row[9] = 0.0;
    }
}

static void write_own(const fmfts_attempt *attempt, frame_problem *problem)
{
    const fmfts_pose_parameters *parameters = attempt->step->parameters;
    problem->magnets[0] = parameters->strength_t_m3;
    problem->magnets[1] = parameters->octupole_m2;
    memcpy(problem->mean, attempt->prior->state, sizeof attempt->prior->state);
    for (size_t c = 0; c < FMFTS_STEP; c++) {
        problem->parts[c] = (uint8_t)parameters->part[c];
        problem->has_prior |= problem->parts[c] == FMFTS_PRIOR || problem->parts[c] == FMFTS_CONSIDERED;
        memcpy(problem->covariance + problem->columns * c, attempt->prior->covariance + FMFTS_STEP * c,
               FMFTS_STEP * sizeof(double));
    }
}

/* Makes columns independent unknowns, each with this standard deviation. */
static void free_columns(frame_problem *problem, size_t first, size_t count, double deviation)
{
    for (size_t c = first; c < first + count; c++) {
        double *row = problem->covariance + problem->columns * c;
        problem->parts[c] = FMFTS_PRIOR;
        memset(row + first, 0, count * sizeof(double));
        row[c] = deviation * deviation;
    }
    problem->has_prior = true;
}

/* A foreign field is a gradient, and a uniform part if the scene holds the ambient field fixed. */
static void add_foreign_field(frame_problem *problem)
{
    free_columns(problem, GRADIENT_COLUMN, BASE_COLUMNS - GRADIENT_COLUMN, FMFTS_FOREIGN_GRADIENT_T_PER_M);
    if (problem->parts[AMBIENT_COLUMN] == FMFTS_FIXED) {
        free_columns(problem, AMBIENT_COLUMN, 3, FMFTS_FOREIGN_UNIFORM_T);
    }
}

static void add_neighbours(const fmfts_felt *felt, frame_problem *problem)
{
    size_t first = first_column(1), width = FMFTS_MOVES * felt->count;
    memcpy(problem->magnets + FMFTS_MAGNET, felt->magnet, felt->count * sizeof felt->magnet[0]);
    memcpy(problem->mean + first_value(1), felt->now, felt->count * sizeof felt->now[0]);
    for (size_t i = 0; i < width; i++) {
        problem->parts[first + i] = FMFTS_PRIOR;
        memcpy(problem->covariance + problem->columns * (first + i) + first, felt->covariance + width * i,
               width * sizeof(double));
    }
    problem->has_prior |= felt->count > 0;
}

static void pose_problem(const fmfts_attempt *attempt, frame_problem *problem)
{
    const fmfts_felt *felt = &attempt->step->felt;
    problem->columns = FMFTS_COLUMNS(1 + felt->count);
    problem->has_prior = false;
    memset(problem->covariance, 0, problem->columns * problem->columns * sizeof(double));
    fmfts_write_measurements(attempt->step, attempt->field_t, problem->measurements);
    write_own(attempt, problem);
    if (attempt->has_foreign_field) {
        add_foreign_field(problem);
    }
    add_neighbours(felt, problem);
    memcpy(problem->start, problem->mean, FMFTS_VALUES(1 + felt->count) * sizeof(double));
}

static void solve_from_start(const fmfts_step *step, const frame_problem *posed, fmfts_solved *solved)
{
    double work[FMFTS_WORK(FMFTS_AXES)], state[FMFTS_VALUES(FMFTS_MAX_MAGNETS)],
        covariance[FMFTS_MAX_COLUMNS * FMFTS_MAX_COLUMNS], direction[FMFTS_MAX_COLUMNS];
    const fmfts_problem problem = {
        .measurements = posed->measurements,
        .rows = 3 * (size_t)step->parameters->sensors,
        .magnets = posed->magnets,
        .magnet_count = 1 + step->felt.count,
        .parts = posed->parts,
        .start = posed->start,
        .prior_mean = posed->has_prior ? posed->mean : NULL,
        .prior_covariance = posed->has_prior ? posed->covariance : NULL,
        .stop_chi2 = STOP_CHI2,
        .max_iterations = FMFTS_MAX_ITERATIONS,
    };
    const fmfts_summary found = fmfts_solve(&problem, work, state, covariance, direction);
    solved->status = found.status;
    solved->freedom = (int)found.rows - (int)found.unknowns;
    solved->chi2 = found.chi2;
    solved->residual_t = found.residual_t;
    memcpy(solved->state, state, sizeof solved->state);
    memcpy(solved->placed, state + first_value(1), step->felt.count * sizeof solved->placed[0]);
    for (size_t c = 0; c < FMFTS_STEP; c++) {
        memcpy(solved->covariance + FMFTS_STEP * c, covariance + posed->columns * c, FMFTS_STEP * sizeof(double));
    }
}

void fmfts_solve_frame(const fmfts_attempt *attempt, fmfts_solved *solved)
{
    const fmfts_step *step = attempt->step;
    const fmfts_pose_parameters *parameters = step->parameters;
    frame_problem problem;
    fmfts_solved again;
    pose_problem(attempt, &problem);
    solve_from_start(step, &problem, solved);
    bool fits = fmfts_fits(parameters, solved, fmfts_strongest(parameters));
    if (fits || step->memory->disturbed_frames % FMFTS_SEARCH_EVERY) {
        return;
    }
    memcpy(problem.start, parameters->rest, LOG_VALUE * sizeof(double)); /* position and axis */
    solve_from_start(step, &problem, &again);
    if (again.status == FMFTS_CONVERGED && !(again.chi2 >= solved->chi2)) {
        *solved = again;
    }
}
