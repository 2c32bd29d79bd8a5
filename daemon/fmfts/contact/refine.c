#include "refine.h"

#include <math.h>
#include <string.h>

#include "../arithmetic/descent.h"
#include "../arithmetic/spline.h"
#include "../pose/algebra.h"

enum { FORCE = 2, SHEAR = 3 }; /* in a press */

static const double FIRST_DAMPING = 1e-3, DAMPING_FACTOR = 10.0;
static const double FARTHEST_LOAD = 3.0; /* presses are searched up to this multiple of the calibrated force */
static const double UNKNOWN = 1e-6;      /* a prior deviation of 1 m: at rest, the place is unknown */
static const double LEAST_FORCE_N = 0.01; /* smallest deviation of the prior of shear: at a force of 0 it would be 0 */

/* A change of pose, and the last trial press: its residual, its slope, and the prior information on each of its
 * shears. */
typedef struct {
    const fmfts_response *response;
    const fmfts_search *search;
    double information[FMFTS_MOVED][FMFTS_MOVED];
    double residual[FMFTS_MOVED], slope[FMFTS_MOVED][FMFTS_MAX_PRESS], chi2, of_shear;
    const double *lowest, *highest;
    bool has_begun;
} cause;

static bool is_positive(double value)
{
    return value > 0.0 && value < INFINITY;
}

bool fmfts_view_response(const void *content, size_t size, fmfts_response *response)
{
    enum { KNOTS_X, KNOTS_Y, MONOMIALS, LOADS, FIRST_X, FIRST_Y, SPACING_X, SPACING_Y, SCALE, HEAD };
    const double *head = content;
    if (size < HEAD * sizeof(double) || !(head[KNOTS_X] >= 2.0 && head[KNOTS_X] <= 10000.0) ||
        !(head[KNOTS_Y] >= 2.0 && head[KNOTS_Y] <= 10000.0) ||
        !(head[MONOMIALS] >= 1.0 && head[MONOMIALS] <= FMFTS_MAX_MONOMIALS) ||
        !(head[LOADS] >= 1.0 && head[LOADS] <= FMFTS_MAX_LOADS) || !is_positive(head[SPACING_X]) ||
        !is_positive(head[SPACING_Y]) || !is_positive(head[SCALE])) {
        return false;
    }
    *response = (fmfts_response){
        .knots = {(size_t)head[KNOTS_X], (size_t)head[KNOTS_Y]},
        .monomials = (size_t)head[MONOMIALS],
        .loads = (size_t)head[LOADS],
        .first_mm = {head[FIRST_X], head[FIRST_Y]},
        .spacing_mm = {head[SPACING_X], head[SPACING_Y]},
        .scale_n = head[SCALE],
        .coefficient = head + HEAD,
    };
    size_t exponents = response->monomials * response->loads;
    size_t coefficients = (response->knots[0] + 2) * (response->knots[1] + 2) * response->monomials * FMFTS_MOVED;
    response->exponent = (const int32_t *)(response->coefficient + coefficients);
    if (size != (HEAD + coefficients) * sizeof(double) + exponents * sizeof(int32_t)) {
        return false;
    }
    for (size_t i = 0; i < exponents; i++) {
        if (response->exponent[i] < 0 || response->exponent[i] > FMFTS_MAX_EXPONENT) {
            return false;
        }
    }
    return true;
}

static void cover(const fmfts_response *response, int axis, double place_mm, fmfts_splines *along)
{
    fmfts_cover(&(fmfts_knots){response->first_mm[axis], response->spacing_mm[axis], response->knots[axis] - 1}, place_mm, along);
}

/* Monomials of the load, and their derivatives. Above scale_n, powers of the normal force follow their tangents. */
static void monomials(const fmfts_response *response, const double *load, double *value,
                      double slope[][FMFTS_MAX_LOADS])
{
    double power[FMFTS_MAX_LOADS][FMFTS_MAX_EXPONENT + 1], by_load[FMFTS_MAX_LOADS][FMFTS_MAX_EXPONENT + 1];
    for (size_t l = 0; l < response->loads; l++) {
        power[l][0] = 1.0;
        by_load[l][0] = 0.0;
        fmfts_powers(load[l] / response->scale_n, l == 0 ? 1.0 : INFINITY, FMFTS_MAX_EXPONENT, power[l] + 1, by_load[l] + 1);
    }
    for (size_t m = 0; m < response->monomials; m++) {
        const int32_t *exponent = response->exponent + m * response->loads;
        value[m] = 1.0;
        for (size_t l = 0; l < response->loads; l++) {
            value[m] *= power[l][exponent[l]];
            slope[m][l] = by_load[l][exponent[l]] / response->scale_n;
            for (size_t other = 0; other < response->loads; other++) {
                slope[m][l] *= other == l ? 1.0 : power[other][exponent[other]];
            }
        }
    }
}

/* with_slope is a constant at each call, so the compiler makes a version without slopes, which takes a fifth of the
 * time. */
FMFTS_INLINE void respond(const fmfts_response *response, const double *press, double change[FMFTS_MOVED],
                          double slope[FMFTS_MOVED][FMFTS_MAX_PRESS], bool with_slope)
{
    double value[FMFTS_MAX_MONOMIALS], by_load[FMFTS_MAX_MONOMIALS][FMFTS_MAX_LOADS];
    fmfts_splines x, y;
    cover(response, 0, press[0], &x);
    cover(response, 1, press[1], &y);
    monomials(response, press + 2, value, by_load);
    memset(change, 0, sizeof(double[FMFTS_MOVED]));
    if (with_slope) {
        memset(slope, 0, sizeof(double[FMFTS_MOVED][FMFTS_MAX_PRESS]));
    }
    for (size_t i = 0; i < FMFTS_COVERING; i++) {
        for (size_t j = 0; j < FMFTS_COVERING; j++) {
            double here = x.value[i] * y.value[j], by_x = x.slope[i] * y.value[j], by_y = x.value[i] * y.slope[j];
            const double *patch = response->coefficient + ((x.cell + i) * (response->knots[1] + 2) + y.cell + j) *
                                                              response->monomials * FMFTS_MOVED;
            for (size_t m = 0; m < response->monomials; m++) {
                for (size_t c = 0; c < FMFTS_MOVED; c++) {
                    double coefficient = patch[m * FMFTS_MOVED + c];
                    change[c] += here * value[m] * coefficient;
                    if (!with_slope) {
                        continue;
                    }
                    slope[c][0] += by_x * value[m] * coefficient;
                    slope[c][1] += by_y * value[m] * coefficient;
                    for (size_t l = 0; l < response->loads; l++) {
                        slope[c][2 + l] += here * by_load[m][l] * coefficient;
                    }
                }
            }
        }
    }
}

void fmfts_respond(const fmfts_response *response, const double *press, double change[FMFTS_MOVED],
                   double slope[FMFTS_MOVED][FMFTS_MAX_PRESS])
{
    respond(response, press, change, slope, true);
}

void fmfts_move(const fmfts_response *response, const double *press, double change[FMFTS_MOVED])
{
    respond(response, press, change, NULL, false);
}

void fmfts_basis(const fmfts_response *response, const double *press, double *basis)
{
    double value[FMFTS_MAX_MONOMIALS], by_load[FMFTS_MAX_MONOMIALS][FMFTS_MAX_LOADS];
    size_t deep = response->knots[1] + 2, monomial = response->monomials;
    fmfts_splines x, y;
    cover(response, 0, press[0], &x);
    cover(response, 1, press[1], &y);
    monomials(response, press + 2, value, by_load);
    memset(basis, 0, (response->knots[0] + 2) * deep * monomial * sizeof(double));
    for (size_t i = 0; i < 16; i++) {
        for (size_t m = 0; m < monomial; m++) {
            basis[((x.cell + i / 4) * deep + y.cell + i % 4) * monomial + m] = x.value[i / 4] * y.value[i % 4] * value[m];
        }
    }
}

double fmfts_shear_information(const fmfts_search *search, double force_n)
{
    double deviation = search->shear_share * (force_n > LEAST_FORCE_N ? force_n : LEAST_FORCE_N);
    return deviation > 0.0 ? 1.0 / (deviation * deviation) : 0.0;
}

static double judge(void *problem, const double *press)
{
    cause *c = problem;
    double modelled[FMFTS_MOVED];
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
    c->of_shear = fmfts_shear_information(c->search, press[FORCE]);
    for (size_t i = SHEAR; i < 2 + c->response->loads; i++) {
        c->chi2 += c->of_shear * press[i] * press[i];
    }
    return c->chi2;
}

/* An unknown that χ² pushes beyond its limit stays on it. Otherwise the others would follow a step that it cannot
 * take. */
static void hold(size_t size, const double *lowest, const double *highest, const double *press, double *normal, double *right)
{
    for (size_t i = 0; i < size; i++) {
        bool is_held = (press[i] <= lowest[i] && right[i] < 0.0) || (press[i] >= highest[i] && right[i] > 0.0);
        right[i] = is_held ? 0.0 : right[i];
        for (size_t j = 0; is_held && j < size; j++) {
            normal[i * size + j] *= j == i ? 1.0 : 0.0;
            normal[j * size + i] *= j == i ? 1.0 : 0.0;
        }
    }
}

static bool take(void *problem, const double *press, double *chi2, double *normal, double *right)
{
    cause *c = problem;
    size_t size = 2 + c->response->loads;
    *chi2 = c->has_begun ? c->chi2 : judge(problem, press);
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
    if (c->search->shear_share > 0.0) {
        hold(size, c->lowest, c->highest, press, normal, right);
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

bool fmfts_refine(const fmfts_response *response, const fmfts_search *wanted, double *press, double *spread, double *chi2)
{
    double lowest[FMFTS_MAX_PRESS], highest[FMFTS_MAX_PRESS], best[FMFTS_MAX_PRESS];
    double room[FMFTS_DESCENT_ROOM(FMFTS_MAX_PRESS)], inverse[FMFTS_MAX_PRESS * FMFTS_MAX_PRESS];
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
    for (size_t i = 0; i < search.unknowns; i++) {
        best[i] = fmfts_within(press[i], lowest[i], highest[i]);
    }
    fmfts_descend(&search, best, chi2, room); /* if no step lowers χ², the best press so far is the answer */
    if (!fmfts_spread_of(search.unknowns, NULL, room, inverse, room + search.unknowns * search.unknowns)) {
        return false;
    }
    memcpy(press, best, search.unknowns * sizeof(double));
    memcpy(spread, inverse, search.unknowns * search.unknowns * sizeof(double));
    return true;
}
