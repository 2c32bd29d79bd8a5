#include "refine.h"

#include <math.h>
#include <string.h>

#include "../arithmetic/descent.h"
#include "../pose/algebra.h"

enum { FORCE = 2, SHEAR = 3 }; /* in a press */

static const double FIRST_DAMPING = 1e-3, DAMPING_FACTOR = 10.0;
static const double FARTHEST_LOAD = 3.0; /* presses are searched up to this multiple of the calibrated force */
static const double UNKNOWN = 1e-6;      /* a prior deviation of 1 m: at rest, the place is unknown */
static const double LEAST_FORCE_N = 0.01; /* least force for the prior of shear, else infinitely narrow */

/* A change of pose, and the last trial press: its residual, its slope, and the prior information on each of its
 * shears. */
typedef struct {
    const fmfts_response *response;
    const fmfts_press_search *search;
    double information[FMFTS_MOVED][FMFTS_MOVED];
    double press[FMFTS_MAX_PRESS], residual[FMFTS_MOVED], slope[FMFTS_MOVED][FMFTS_MAX_PRESS], chi2, of_shear;
    const double *lowest, *highest;
    bool has_begun;
} cause;

/* The prior's information (1/N²) on each shear of a press with this force. */
static double shear_information(const fmfts_press_search *search, double force_n)
{
    double deviation = search->shear_share * (force_n > LEAST_FORCE_N ? force_n : LEAST_FORCE_N);
    return deviation > 0.0 ? 1.0 / (deviation * deviation) : 0.0;
}

static double judge(void *problem, const double *press)
{
    cause *c = problem;
    double modelled[FMFTS_MOVED];
    size_t bytes = (2 + c->response->loads) * sizeof(double);
    if (c->has_begun && memcmp(c->press, press, bytes) == 0) {
        return c->chi2; /* the last step was the best */
    }
    memcpy(c->press, press, bytes);
    fmfts_respond(c->response, press, modelled, c->slope);
    c->has_begun = true;
    c->chi2 = 0.0;
    for (int i = 0; i < FMFTS_MOVED; i++) {
        c->residual[i] = c->search->change[i] - modelled[i];
    }
    for (int i = 0; i < FMFTS_MOVED; i++) {
        for (int k = 0; k < FMFTS_MOVED; k++) {
            c->chi2 += c->residual[i] * c->information[i][k] * c->residual[k];
        }
    }
    c->of_shear = shear_information(c->search, press[FORCE]);
    for (size_t i = SHEAR; i < 2 + c->response->loads; i++) {
        c->chi2 += c->of_shear * press[i] * press[i];
    }
    return c->chi2;
}

/* Keeps an unknown where it is. Otherwise the others would follow a step that it cannot take. */
static void hold(size_t size, size_t held, double *normal, double *right)
{
    right[held] = 0.0;
    for (size_t i = 0; i < size; i++) {
        normal[held * size + i] *= i == held ? 1.0 : 0.0;
        normal[i * size + held] *= i == held ? 1.0 : 0.0;
    }
}

/* The normal matrix and the right-hand side at the press that was judged last. */
static void weigh(const cause *c, const double *press, double *normal, double *right)
{
    size_t size = 2 + c->response->loads;
    for (size_t i = 0; i < size; i++) {
        double weighted[FMFTS_MOVED] = {0};
        for (int k = 0; k < FMFTS_MOVED; k++) {
            for (int d = 0; d < FMFTS_MOVED; d++) {
                weighted[d] += c->slope[k][i] * c->information[k][d];
            }
        }
        right[i] = 0.0;
        for (size_t j = 0; j < size; j++) {
            normal[i * size + j] = i == j ? UNKNOWN : 0.0;
            for (int d = 0; d < FMFTS_MOVED; d++) {
                normal[i * size + j] += weighted[d] * c->slope[d][j];
            }
        }
        for (int d = 0; d < FMFTS_MOVED; d++) {
            right[i] += weighted[d] * c->residual[d];
        }
    }
    for (size_t i = SHEAR; i < size; i++) {
        normal[i * size + i] += c->of_shear;
        right[i] -= c->of_shear * press[i];
        if (press[FORCE] > LEAST_FORCE_N) { /* more force makes the same shear likelier */
            double by_force = c->of_shear * press[i] / press[FORCE];
            normal[FORCE * size + i] -= by_force;
            normal[i * size + FORCE] -= by_force;
            normal[FORCE * size + FORCE] += by_force * press[i] / press[FORCE];
            right[FORCE] += by_force * press[i];
        }
    }
}

static bool take(void *problem, const double *press, double *chi2, double *normal, double *right)
{
    cause *c = problem;
    size_t size = 2 + c->response->loads;
    *chi2 = judge(problem, press);
    weigh(c, press, normal, right);
    for (size_t i = 0; c->search->shear_share > 0.0 && i < size; i++) {
        bool pushed = (press[i] <= c->lowest[i] && right[i] < 0.0) || (press[i] >= c->highest[i] && right[i] > 0.0);
        if (pushed || (c->search->holds_force && i == FORCE)) {
            hold(size, i, normal, right);
        }
    }
    return true;
}

/* lowest, highest: the limits of a press on the table. */
static void limit(const fmfts_response *response, double *lowest, double *highest)
{
    double farthest = FARTHEST_LOAD * response->scale_n;
    for (int axis = 0; axis < 2; axis++) {
        lowest[axis] = response->first_mm[axis];
        highest[axis] = fmfts_last_mm(response, axis);
    }
    for (size_t l = 0; l < response->loads; l++) {
        lowest[2 + l] = l == 0 ? 0.0 : -farthest;
        highest[2 + l] = farthest;
    }
}

bool fmfts_information(const double *covariance, double information[FMFTS_MOVED][FMFTS_MOVED])
{
    fmfts_matrix matrix, factored, inverse;
    for (size_t c = 0; c < FMFTS_MOVED; c++) {
        memcpy(matrix[c], covariance + c * FMFTS_MOVED, sizeof(double[FMFTS_MOVED]));
    }
    if (!factor(FMFTS_MOVED, matrix, 0.0, factored)) {
        return false;
    }
    invert_factored(FMFTS_MOVED, factored, inverse);
    for (size_t c = 0; c < FMFTS_MOVED; c++) {
        memcpy(information[c], inverse[c], sizeof(double[FMFTS_MOVED]));
    }
    return true;
}

bool fmfts_refine(const fmfts_response *response, const fmfts_press_search *wanted, double *press, double *spread, double *chi2)
{
    double lowest[FMFTS_MAX_PRESS], highest[FMFTS_MAX_PRESS], best[FMFTS_MAX_PRESS];
    double room[FMFTS_DESCENT_ROOM(FMFTS_MAX_PRESS)], inverse[FMFTS_MAX_PRESS * FMFTS_MAX_PRESS], right[FMFTS_MAX_PRESS];
    cause problem = {.response = response, .search = wanted, .lowest = lowest, .highest = highest};
    fmfts_descent search = {
        .unknowns = 2 + response->loads,
        .iterations = wanted->steps > 0 ? (size_t)wanted->steps : 0,
        .settled = wanted->settled,
        .damping = FIRST_DAMPING,
        .damping_factor = DAMPING_FACTOR,
        .most_damping = INFINITY,
        .lowest = lowest,
        .highest = highest,
        .problem = &problem,
        .judge = judge,
        .take = take,
    };
    if (!fmfts_information(wanted->covariance, problem.information)) {
        return false;
    }
    limit(response, lowest, highest);
    if (wanted->holds_force) {
        lowest[FORCE] = highest[FORCE] = press[FORCE];
    }
    for (size_t i = 0; i < search.unknowns; i++) {
        best[i] = fmfts_within(press[i], lowest[i], highest[i]);
    }
    fmfts_descend(&search, best, chi2, room); /* if no step lowers χ², the best press so far is the answer */
    if (wanted->shear_share > 0.0) { /* an unknown on its limit is as uncertain as others */
        judge(&problem, best);
        weigh(&problem, best, room, right);
        if (wanted->holds_force) {
            hold(search.unknowns, FORCE, room, right);
        }
    }
    if (!fmfts_spread_of(search.unknowns, NULL, room, inverse, room + search.unknowns * search.unknowns)) {
        return false;
    }
    memcpy(press, best, search.unknowns * sizeof(double));
    memcpy(spread, inverse, search.unknowns * search.unknowns * sizeof(double));
    return true;
}
