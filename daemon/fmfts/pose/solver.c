/* Levenberg–Marquardt on measurements and prior.
 *
 * The residuals are ρ = (measured − predicted)/deviation, and J is the Jacobian of the prediction. d is the step from the
 * prior's mean, and Ω = P⁻¹ the prior's information. Each step h solves (A + λ diag A) h = g, where A = JᵀJ + DᵀΩD,
 * g = Jᵀρ − DᵀΩd, and D is the derivative of d: the identity, except for the axis, which lies on a sphere (docs/pose.md).
 *
 * arithmetic/descent.c is not called, for time: here a point's χ² comes with its normal equations, the last step needs neither, and
 * the factors of common sizes are unrolled. A damped step of six unknowns takes 64 ns; by matrix.c it takes 160.
 */
#include "solver.h"

#include <string.h>

#include "search.h"

#define FIRST_DAMPING 1e-4
#define NO_DAMPING 1e-7 /* below this, Marquardt's step equals the Gauss–Newton step */
#define ROUNDING 1e-12  /* relative error of a sum of squares */
/* Correct explanations reach the wanted χ² in two steps, and hardly ever need more than ten. */
#define VAIN_ITERATIONS 12

/* step: Marquardt's step. Returns the decrease of χ² that the linear model promises for it; −∞ if there is no step. */
FMFTS_INLINE double damped_step_of(size_t n, size_t last, fmfts_linear *here, double damping, fmfts_matrix work,
                                   double *step)
{
    if (!factor(n, here->a, damping, work)) {
        return -INFINITY;
    }
    for (size_t i = 0; i < n; i++) {
        step[i] = here->a[i][last];
    }
    solve_factored(n, work, step);
    double sum = 0.0;
    for (size_t i = 0; i < n; i++) {
        sum += step[i] * (here->a[i][last] + damping * here->a[i][i] * step[i]);
    }
    return sum;
}

static double damped_step(const fmfts_pose_search *search, fmfts_linear *here, double damping, fmfts_matrix work, double *step)
{
    size_t last = search->ordered;
    switch (search->active) {
    case 5:
        return damped_step_of(5, last, here, damping, work, step);
    case 6:
        return damped_step_of(6, last, here, damping, work, step);
    case 8:
        return damped_step_of(8, last, here, damping, work, step);
    case 13:
        return damped_step_of(13, last, here, damping, work, step);
    case 14:
        return damped_step_of(14, last, here, damping, work, step);
    default:
        return damped_step_of(search->active, last, here, damping, work, step);
    }
}

/* tried = state moved by a step over the active columns; axes stay unit vectors. */
static void take_step(const fmfts_pose_search *search, const double *state, const double *step, double *tried)
{
    const fmfts_problem *problem = search->problem;
    double move[FMFTS_MAX_COLUMNS];
    fmfts_fill(move, search->columns, 0.0);
    for (size_t i = 0; i < search->active; i++) {
        move[search->order[i]] = step[i];
    }
    for (size_t i = 0; i < BASE_COLUMNS - AMBIENT_COLUMN; i++) {
        tried[AMBIENT_VALUE + i] = state[AMBIENT_VALUE + i] + move[AMBIENT_COLUMN + i];
    }
    for (size_t m = 0; m < problem->magnet_count; m++) {
        const double *from = state + first_value(m), *by = move + first_column(m);
        double *to = tried + first_value(m), basis[2][3];
        tangent_basis(from + AXIS_VALUE, basis);
        for (int i = 0; i < 3; i++) {
            to[i] = from[i] + by[i];
            to[AXIS_VALUE + i] = from[AXIS_VALUE + i] + by[TILT_COLUMN] * basis[0][i] + by[TILT_COLUMN + 1] * basis[1][i];
        }
        double length = sqrt(dot3(to + AXIS_VALUE, to + AXIS_VALUE));
        for (int i = 0; i < 3; i++) {
            to[AXIS_VALUE + i] /= length;
        }
        to[LOG_VALUE] = from[LOG_VALUE] + by[LOG_COLUMN];
    }
}

/* Whether to give up: after many steps χ² is still above the wanted one, or the magnet is too far away. Such searches
 * hardly ever succeed. */
static bool is_vain(const fmfts_problem *problem, const fmfts_pose_descent *d, const double *state)
{
    double away[3];
    for (int i = 0; i < 3; i++) {
        away[i] = state[i] - problem->start[i];
    }
    return (problem->wanted_chi2 > 0.0 && d->iterations >= VAIN_ITERATIONS && d->chi2 > problem->wanted_chi2) ||
           (problem->reach_m > 0.0 && dot3(away, away) > problem->reach_m * problem->reach_m);
}

/* Moves `state` to the minimum, or until the limit of iterations. */
static void descend(fmfts_pose_search *search, fmfts_pose_descent *d, double *state)
{
    const fmfts_problem *problem = search->problem;
    size_t values = FMFTS_VALUES(problem->magnet_count);
    double damping = 0.0;
    while (d->iterations < problem->max_iterations && !is_vain(problem, d, state)) {
        double step[FMFTS_STRIDE], tried[FMFTS_VALUES(FMFTS_MAX_MAGNETS)];
        double promised = damped_step(search, d->here, damping, *d->work, step);
        if (promised == -INFINITY) {
            damping = fmax(FIRST_DAMPING, 10.0 * damping);
            d->iterations++;
            continue;
        }
        take_step(search, state, step, tried);
        if (promised <= problem->stop_chi2 && damping <= FIRST_DAMPING) {
            /* The remaining gain is not worth another evaluation of the model: take the step and stop. */
            memcpy(state, tried, values * sizeof(double));
            d->chi2 -= promised;
            d->converged = true;
            d->factored = damping == 0.0;
            return;
        }
        d->iterations++;
        if (problem->project) {
            fmfts_best_linear_parts(search, tried);
        }
        double chi2 = fmfts_linearise(search, tried, d->there);
        if (chi2 <= d->chi2 * (1.0 + ROUNDING)) {
            fmfts_linear *before = d->here;
            d->here = d->there;
            d->there = before;
            d->chi2 = chi2;
            memcpy(state, tried, values * sizeof(double));
            damping = damping > NO_DAMPING ? 0.1 * damping : 0.0;
        } else {
            damping = fmax(FIRST_DAMPING, 10.0 * damping);
        }
    }
}

static fmfts_summary solve(const fmfts_problem *problem, double *work, double *state, double *covariance,
                           double *direction)
{
    fmfts_pose_search search;
    fmfts_linear first, second;
    fmfts_matrix factored;
    fmfts_pose_descent d = {.here = &first, .there = &second, .work = &factored};
    fmfts_summary summary = {.status = FMFTS_INVALID, .chi2 = NAN, .residual_t = NAN};
    size_t values = FMFTS_VALUES(problem->magnet_count), columns = FMFTS_COLUMNS(problem->magnet_count);
    if (direction) {
        fmfts_fill(direction, columns, NAN);
    }
    memcpy(state, problem->start, values * sizeof(double));
    for (size_t c = 0; c < columns; c++) {
        summary.unknowns += problem->parts[c] == FMFTS_FREE;
    }
    search.problem = problem;
    search.columns = columns;
    search.active = search.ordered = 0;
    search.sources.with_gradient = true; /* assumed until the columns are known */
    search.sources.count = problem->magnet_count;
    if (!fmfts_valid(problem)) {
        return summary;
    }
    fmfts_fill(search.sources.log_moment, problem->magnet_count, NAN);
    place_sources(problem->magnets, problem->start, &search.sources);
    if (!fmfts_prepare_rows(&search, (fmfts_row *)work) || !fmfts_prepare_columns(&search, factored)) {
        return summary;
    }
    if (problem->project) {
        fmfts_best_linear_parts(&search, state);
    }
    d.chi2 = fmfts_linearise(&search, state, d.here);
    if (d.chi2 == INFINITY) {
        return summary;
    }
    descend(&search, &d, state);
    summary.status = fmfts_conclude(&search, &d, state, covariance, direction);
    summary.rows = summary.status == FMFTS_INVALID ? 0 : search.row_count;
    if (summary.status == FMFTS_CONVERGED || summary.status == FMFTS_AT_LIMIT) {
        summary.chi2 = d.chi2;
        summary.residual_t = search.row_count ? sqrt(d.here->raw_square / (double)search.row_count) : 0.0;
        summary.iterations = d.iterations;
    }
    return summary;
}

fmfts_summary fmfts_solve(const fmfts_problem *problem, double *work, double *state, double *covariance,
                          double *direction)
{
    fmfts_summary summary = solve(problem, work, state, covariance, direction);
    if (summary.status == FMFTS_UNOBSERVABLE || summary.status == FMFTS_INVALID) {
        size_t columns = FMFTS_COLUMNS(problem->magnet_count);
        fmfts_fill(covariance, columns * columns, NAN);
    }
    return summary;
}
