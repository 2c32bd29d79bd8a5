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
