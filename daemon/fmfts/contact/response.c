/* The table of a pad's response: response.py explains it. */
#include <math.h>
#include <string.h>

#include "../arithmetic/spline.h"
#include "../pose/algebra.h"
#include "refine.h"

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
        if ((size_t)response->exponent[i] > response->most_exponent) {
            response->most_exponent = (size_t)response->exponent[i];
        }
    }
    return true;
}

static void cover(const fmfts_response *response, int axis, double place_mm, fmfts_splines *along)
{
    fmfts_cover(&(fmfts_knots){response->first_mm[axis], response->spacing_mm[axis], response->knots[axis] - 1}, place_mm, along);
}

/* Monomials of the load, and their derivatives unless slope is NULL. Above scale_n, powers of the normal force follow their tangents. */
FMFTS_INLINE void monomials(const fmfts_response *response, const double *load, double *value, double slope[][FMFTS_MAX_LOADS])
{
    double power[FMFTS_MAX_LOADS][FMFTS_MAX_EXPONENT + 1], by_load[FMFTS_MAX_LOADS][FMFTS_MAX_EXPONENT + 1];
    for (size_t l = 0; l < response->loads; l++) {
        power[l][0] = 1.0;
        by_load[l][0] = 0.0;
        fmfts_powers(load[l] / response->scale_n, l == 0 ? 1.0 : INFINITY, response->most_exponent, power[l] + 1, by_load[l] + 1);
    }
    for (size_t m = 0; m < response->monomials; m++) {
        const int32_t *exponent = response->exponent + m * response->loads;
        value[m] = 1.0;
        for (size_t l = 0; l < response->loads; l++) {
            value[m] *= power[l][exponent[l]];
        }
        for (size_t l = 0; slope && l < response->loads; l++) {
            slope[m][l] = by_load[l][exponent[l]] / response->scale_n;
            for (size_t other = 0; other < response->loads; other++) {
                slope[m][l] *= other == l ? 1.0 : power[other][exponent[other]];
            }
        }
    }
}

/* out[c · stride] = Σ_m weight[m · step] · sum[m][c] */
static inline void weigh(const fmfts_response *response, const double *weight, size_t step, const double *sum, double *out, size_t stride)
{
    double own[FMFTS_MOVED] = {0.0};
    for (size_t m = 0; m < response->monomials; m++) {
        for (size_t c = 0; c < FMFTS_MOVED; c++) {
            own[c] += weight[m * step] * sum[m * FMFTS_MOVED + c];
        }
    }
    for (size_t c = 0; c < FMFTS_MOVED; c++) {
        out[c * stride] = own[c];
    }
}

/* slope: NULL: only the change. That is a constant at each call, so the compiler makes a version without slopes. */
FMFTS_INLINE void respond(const fmfts_response *response, const double *press, double change[FMFTS_MOVED],
                          double slope[FMFTS_MOVED][FMFTS_MAX_PRESS])
{
    double value[FMFTS_MAX_MONOMIALS], by_load[FMFTS_MAX_MONOMIALS][FMFTS_MAX_LOADS];
    double sum[FMFTS_LAPLACIAN][FMFTS_MAX_MONOMIALS * FMFTS_MOVED];
    size_t numbers = response->monomials * FMFTS_MOVED;
    fmfts_splines x, y;
    fmfts_patch patch;
    cover(response, 0, press[0], &x);
    cover(response, 1, press[1], &y);
    monomials(response, press + 2, value, slope ? by_load : NULL);
    fmfts_cover_place(response->coefficient, response->knots[1] + 2, numbers, &x, &y, &patch);
    fmfts_add_up(&patch, slope ? FMFTS_LAPLACIAN : FMFTS_VALUE + 1, 0, numbers, sum[0], FMFTS_MAX_MONOMIALS * FMFTS_MOVED);
    weigh(response, value, 1, sum[FMFTS_VALUE], change, 1);
    if (!slope) {
        return;
    }
    weigh(response, value, 1, sum[FMFTS_BY_X], &slope[0][0], FMFTS_MAX_PRESS);
    weigh(response, value, 1, sum[FMFTS_BY_Y], &slope[0][1], FMFTS_MAX_PRESS);
    for (size_t l = 0; l < response->loads; l++) {
        weigh(response, by_load[0] + l, FMFTS_MAX_LOADS, sum[FMFTS_VALUE], &slope[0][2 + l], FMFTS_MAX_PRESS);
    }
}

FMFTS_WIDE void fmfts_respond(const fmfts_response *response, const double *press, double change[FMFTS_MOVED],
                   double slope[FMFTS_MOVED][FMFTS_MAX_PRESS])
{
    respond(response, press, change, slope);
}

FMFTS_WIDE void fmfts_move(const fmfts_response *response, const double *press, double change[FMFTS_MOVED])
{
    respond(response, press, change, NULL);
}

void fmfts_basis(const fmfts_response *response, const double *press, double *basis)
{
    double value[FMFTS_MAX_MONOMIALS];
    size_t deep = response->knots[1] + 2, monomial = response->monomials;
    fmfts_splines x, y;
    cover(response, 0, press[0], &x);
    cover(response, 1, press[1], &y);
    monomials(response, press + 2, value, NULL);
    memset(basis, 0, (response->knots[0] + 2) * deep * monomial * sizeof(double));
    for (size_t i = 0; i < 16; i++) {
        for (size_t m = 0; m < monomial; m++) {
            basis[((x.cell + i / 4) * deep + y.cell + i % 4) * monomial + m] = x.value[i / 4] * y.value[i % 4] * value[m];
        }
    }
}
