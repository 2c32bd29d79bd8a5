#include "refine.h"

#include <math.h>
#include <string.h>

#include "../pose/algebra.h"

static const double FIRST_DAMPING = 1e-3, DAMPING_FACTOR = 10.0;
static const double FARTHEST_LOAD = 3.0; /* presses are searched up to this multiple of the calibrated force */
static const double UNKNOWN = 1e-6;      /* a prior deviation of 1 m: at rest, the place is unknown */

typedef struct {
    double press[FMFTS_MAX_PRESS], residual[FMFTS_MOVED], slope[FMFTS_MOVED][FMFTS_MAX_PRESS], chi2;
} point;

/* NaN is the lowest. */
static double clamped(double value, double lowest, double highest)
{
    return !(value >= lowest) ? lowest : value > highest ? highest : value;
}

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

/* Values and derivatives of the four cubic B-splines that cover a place. Returns the index of the first. */
static size_t stencil(const fmfts_response *response, int axis, double place_mm, double value[4], double slope[4])
{
    double last = (double)response->knots[axis] - 1.0, spacing = response->spacing_mm[axis];
    double place = clamped((place_mm - response->first_mm[axis]) / spacing, 0.0, last);
    size_t cell = (size_t)clamped(place, 0.0, last - 1.0);
    double u = place - (double)cell, v = 1.0 - u;
    value[0] = v * v * v / 6.0;
    value[1] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0;
    value[2] = (-3.0 * u * u * u + 3.0 * u * u + 3.0 * u + 1.0) / 6.0;
    value[3] = u * u * u / 6.0;
    slope[0] = -v * v / 2.0 / spacing;
    slope[1] = (3.0 * u * u - 4.0 * u) / 2.0 / spacing;
    slope[2] = (-3.0 * u * u + 2.0 * u + 1.0) / 2.0 / spacing;
    slope[3] = u * u / 2.0 / spacing;
    return cell;
}

/* Monomials of the load, and their derivatives. Above scale_n, powers of the normal force follow their tangents. */
static void monomials(const fmfts_response *response, const double *load, double *value,
                      double slope[][FMFTS_MAX_LOADS])
{
    double power[FMFTS_MAX_LOADS][FMFTS_MAX_EXPONENT + 1], by_load[FMFTS_MAX_LOADS][FMFTS_MAX_EXPONENT + 1];
    for (size_t l = 0; l < response->loads; l++) {
        double whole = load[l] / response->scale_n, beyond = l == 0 && whole > 1.0 ? whole - 1.0 : 0.0;
        double inside = whole - beyond, lower = 1.0;
        power[l][0] = 1.0;
        by_load[l][0] = 0.0;
        for (int e = 1; e <= FMFTS_MAX_EXPONENT; e++) {
            by_load[l][e] = e * lower;
            lower *= inside;
            power[l][e] = lower + by_load[l][e] * beyond;
        }
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

/* with_slope is a constant wherever this stands: values alone take a fifth of the time. */
FMFTS_INLINE void respond(const fmfts_response *response, const double *press, double change[FMFTS_MOVED],
                          double slope[FMFTS_MOVED][FMFTS_MAX_PRESS], bool with_slope)
{
    double along_x[4], along_y[4], slope_x[4], slope_y[4];
    double value[FMFTS_MAX_MONOMIALS], by_load[FMFTS_MAX_MONOMIALS][FMFTS_MAX_LOADS];
    size_t column = stencil(response, 0, press[0], along_x, slope_x);
    size_t row = stencil(response, 1, press[1], along_y, slope_y);
    monomials(response, press + 2, value, by_load);
    memset(change, 0, sizeof(double[FMFTS_MOVED]));
    if (with_slope) {
        memset(slope, 0, sizeof(double[FMFTS_MOVED][FMFTS_MAX_PRESS]));
    }
    for (size_t i = 0; i < 4; i++) {
        for (size_t j = 0; j < 4; j++) {
            double here = along_x[i] * along_y[j], by_x = slope_x[i] * along_y[j], by_y = along_x[i] * slope_y[j];
            const double *patch = response->coefficient + ((column + i) * (response->knots[1] + 2) + row + j) *
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

static void bring_onto_table(const fmfts_response *response, double *press)
{
    for (int axis = 0; axis < 2; axis++) {
        double first = response->first_mm[axis];
        press[axis] = clamped(press[axis], first, first + response->spacing_mm[axis] * (double)(response->knots[axis] - 1));
    }
    for (size_t l = 0; l < response->loads; l++) {
        double farthest = FARTHEST_LOAD * response->scale_n;
        press[2 + l] = clamped(press[2 + l], l == 0 ? 0.0 : -farthest, farthest);
    }
}

static void judge(const fmfts_response *response, const double *change, fmfts_matrix information, point *at)
{
    double modelled[FMFTS_MOVED];
    bring_onto_table(response, at->press);
    fmfts_respond(response, at->press, modelled, at->slope);
    at->chi2 = 0.0;
    for (int c = 0; c < FMFTS_MOVED; c++) {
        at->residual[c] = change[c] - modelled[c];
    }
    for (int c = 0; c < FMFTS_MOVED; c++) {
        for (int d = 0; d < FMFTS_MOVED; d++) {
            at->chi2 += at->residual[c] * information[c][d] * at->residual[d];
        }
    }
}

/* normal: the information on the press, (2 + loads)². gradient: for Levenberg–Marquardt. */
static void normal_equations(const point *at, fmfts_matrix information, size_t size, fmfts_matrix normal, double *gradient)
{
    for (size_t i = 0; i < size; i++) {
        double weighted[FMFTS_MOVED] = {0};
        for (int c = 0; c < FMFTS_MOVED; c++) {
            for (int d = 0; d < FMFTS_MOVED; d++) {
                weighted[d] += at->slope[c][i] * information[c][d];
            }
        }
        gradient[i] = 0.0;
        for (size_t j = 0; j < size; j++) {
            normal[i][j] = i == j ? UNKNOWN : 0.0;
            for (int d = 0; d < FMFTS_MOVED; d++) {
                normal[i][j] += weighted[d] * at->slope[d][j];
            }
        }
        for (int d = 0; d < FMFTS_MOVED; d++) {
            gradient[i] += weighted[d] * at->residual[d];
        }
    }
}

bool fmfts_refine(const fmfts_response *response, const double change[FMFTS_MOVED], const double *covariance, int steps,
                  double *press, double *spread)
{
    fmfts_matrix matrix, factored, information, normal;
    double gradient[FMFTS_MAX_PRESS], damping = FIRST_DAMPING;
    size_t size = 2 + response->loads;
    point best = {0}, trial = {0};
    for (size_t c = 0; c < FMFTS_MOVED; c++) {
        memcpy(matrix[c], covariance + c * FMFTS_MOVED, sizeof(double[FMFTS_MOVED]));
    }
    if (!factor(FMFTS_MOVED, matrix, 0.0, factored)) {
        return false;
    }
    invert_factored(FMFTS_MOVED, factored, information);
    memcpy(best.press, press, size * sizeof(double));
    judge(response, change, information, &best);
    normal_equations(&best, information, size, normal, gradient);
    for (int step = 0; step < steps && factor(size, normal, damping, factored); step++) {
        double move[FMFTS_MAX_PRESS];
        memcpy(move, gradient, sizeof(move));
        solve_factored(size, factored, move);
        for (size_t i = 0; i < size; i++) {
            trial.press[i] = best.press[i] + move[i];
        }
        judge(response, change, information, &trial);
        if (trial.chi2 <= best.chi2) {
            best = trial;
            damping /= DAMPING_FACTOR;
            normal_equations(&best, information, size, normal, gradient);
        } else {
            damping *= DAMPING_FACTOR;
        }
    }
    if (!factor(size, normal, 0.0, factored)) {
        return false;
    }
    invert_factored(size, factored, matrix);
    memcpy(press, best.press, size * sizeof(double));
    for (size_t i = 0; i < size; i++) {
        memcpy(spread + i * size, matrix[i], size * sizeof(double));
    }
    return true;
}
