/* The most likely state of one frame, from the prior and the measured field. */
#include <string.h>

#include "foreign_field.h"
#include "model.h"
#include "tracking.h"

/* Solve to a thousandth of a deviation: before rest is recorded, deviations include the mounting's tolerances (0.4 mm). */
static const double STOP_CHI2 = 1e-6;
/* Stop a wrong explanation early: it would take fifty steps, to a pose that is not published. */
static const double ROUGH_CHI2 = 0.1;
enum { ROUGH_ITERATIONS = 18 };
/* Of 130,000 solves that ended near rest, none was farther away than 20 mm on its way. */
static const double REACH_M = 0.03;

/* The pad's own magnet and its neighbours as one problem. A neighbour's prior is its own pad's last estimate. */
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
    if (parameters->part[AMBIENT_COLUMN] == FMFTS_FIXED) {
        memcpy(problem->mean + AMBIENT_VALUE, parameters->rest + AMBIENT_VALUE, 3 * sizeof(double));
    }
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

/* Prior deviation of the ambient field from its mean, independent of the frame before. */
#define ALTERNATES_T 1e-5
/* Deviation of the moment, whose mean of recent seconds is used: one frame cannot separate moment and field. */
#define MOMENT_DEVIATION 5e-4

static void forget_correlation(frame_problem *problem, size_t column)
{
    for (size_t c = 0; c < FMFTS_STEP; c++) {
        problem->covariance[problem->columns * c + column] = problem->covariance[problem->columns * column + c] = 0.0;
    }
}

static void let_alternate(const fmfts_step *step, frame_problem *problem)
{
    const fmfts_pose_memory *memory = step->memory;
    for (size_t c = AMBIENT_COLUMN; c < GRADIENT_COLUMN; c++) {
        problem->covariance[(problem->columns + 1) * c] += ALTERNATES_T * ALTERNATES_T;
    }
    if (problem->parts[AMBIENT_COLUMN] != FMFTS_FIXED) {
        return;
    }
    for (size_t c = LOG_COLUMN; c < GRADIENT_COLUMN; c++) {
        forget_correlation(problem, c);
    }
    free_columns(problem, AMBIENT_COLUMN, 3, ALTERNATES_T);
    problem->mean[LOG_VALUE] = memory->steady_moment;
    free_columns(problem, LOG_COLUMN, 1, sqrt(memory->steady_variance + MOMENT_DEVIATION * MOMENT_DEVIATION));
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
    if (attempt->step->memory->alternates) {
        let_alternate(attempt->step, problem);
    }
    if (attempt->has_foreign_field) {
        add_foreign_field(problem);
    }
    add_neighbours(felt, problem);
    memcpy(problem->start, problem->mean, FMFTS_VALUES(1 + felt->count) * sizeof(double));
}

/* The largest χ² that fits; NaN without a degree of freedom. */
static double gate_of(const fmfts_step *step, const frame_problem *posed)
{
    int freedom = 0;
    for (int axis = 0; axis < 3 * (int)step->parameters->sensors; axis++) {
        freedom += isfinite(posed->measurements[FMFTS_MEASUREMENT * axis + 6]);
    }
    for (size_t c = 0; c < posed->columns; c++) {
        freedom -= posed->parts[c] == FMFTS_FREE;
    }
    return step->parameters->gate_chi2[freedom > 0 ? freedom : 0];
}

static void solve_from_start(const fmfts_step *step, const frame_problem *posed, bool is_rough, fmfts_solved *solved)
{
    double work[FMFTS_WORK(FMFTS_AXES)], state[FMFTS_VALUES(FMFTS_MAX_MAGNETS)],
        covariance[FMFTS_MAX_COLUMNS * FMFTS_MAX_COLUMNS];
    const fmfts_problem problem = {
        .measurements = posed->measurements,
        .rows = 3 * (size_t)step->parameters->sensors,
        .magnets = posed->magnets,
        .magnet_count = 1 + step->felt.count,
        .parts = posed->parts,
        .start = posed->start,
        .prior_mean = posed->has_prior ? posed->mean : NULL,
        .prior_covariance = posed->has_prior ? posed->covariance : NULL,
        .stop_chi2 = is_rough ? ROUGH_CHI2 : STOP_CHI2,
        .reach_m = REACH_M,
        .wanted_chi2 = is_rough ? gate_of(step, posed) : 0.0,
        .max_iterations = is_rough ? ROUGH_ITERATIONS : FMFTS_MAX_ITERATIONS,
    };
    const fmfts_summary found = fmfts_solve(&problem, work, state, covariance, NULL);
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

/* Whether another start is useless. A magnet alone has one plausible pose, which all starts find; beside a foreign
 * field there may be two. */
static bool is_settled(const fmfts_attempt *attempt, const fmfts_solved *solved)
{
    const fmfts_pose_parameters *parameters = attempt->step->parameters;
    if (attempt->has_foreign_field) {
        return fmfts_fits(parameters, solved, fmfts_strongest(parameters));
    }
    return attempt->is_doubtful || fmfts_has_plausible_pose(parameters, solved, FMFTS_LOG_MOMENT_REACH);
}

/* Solves from rest, too. That solution is used if it converged, and fits better or is the only one that converged. */
static void solve_from_rest(const fmfts_step *step, frame_problem *problem, bool is_rough, fmfts_solved *solved)
{
    fmfts_solved again;
    memcpy(problem->start, step->parameters->rest, LOG_VALUE * sizeof(double)); /* position and axis */
    solve_from_start(step, problem, is_rough, &again);
    if (again.status == FMFTS_CONVERGED && (solved->status != FMFTS_CONVERGED || again.chi2 < solved->chi2)) {
        *solved = again;
    }
}

void fmfts_solve_frame(const fmfts_attempt *attempt, fmfts_solved *solved)
{
    const fmfts_step *step = attempt->step;
    const fmfts_pose_parameters *parameters = step->parameters;
    frame_problem problem;
    pose_problem(attempt, &problem);
    solve_from_start(step, &problem, attempt->is_doubtful, solved);
    if (!is_settled(attempt, solved) && step->memory->disturbed_frames % FMFTS_SEARCH_EVERY == 0) {
        solve_from_rest(step, &problem, attempt->is_doubtful, solved);
    }
    if (attempt->is_doubtful && !attempt->has_foreign_field && fmfts_fits(parameters, solved, fmfts_strongest(parameters))) {
        memcpy(problem.start, solved->state, sizeof solved->state);
        memcpy(problem.start + first_value(1), solved->placed, step->felt.count * sizeof solved->placed[0]);
        solve_from_start(step, &problem, false, solved);
    }
}
