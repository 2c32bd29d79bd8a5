// The contact network and the table of a pad's response, in memory of exactly their size: accepted data have the size
// that their head states, and whatever the numbers, nothing else is read or written. The first byte chooses between
// them and makes the memory a number shorter, right, or longer; the next bytes are sizes; the rest, repeated, gives the
// numbers.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../../daemon/fmfts/contact/network.h"
#include "../../daemon/fmfts/contact/refine.h"
#include "../firmware/fuzz/fuzz.h"

enum { SIZES = 4, HEAD = 1 + SIZES, STEPS = 3 };

// `count` bytes of what the input holds, over and over.
static void fill(void *numbers, size_t count, const uint8_t *data, size_t size)
{
    memset(numbers, 0, count);
    for (size_t at = 0; size && at < count; at += size)
        memcpy((uint8_t *)numbers + at, data, count - at < size ? count - at : size);
}

static void *memory(size_t size)
{
    void *exact = malloc(size ? size : 1);
    require(exact != NULL, "there is memory");
    return exact;
}

static void network(const uint8_t *sizes, int longer, const uint8_t *data, size_t size)
{
    size_t hidden = sizes[0] < 254 ? sizes[0] % 20 : sizes[0] + 2, outputs = sizes[1] % 8;
    size_t right = 3 + 6 + 6 * 5 + 10 * hidden + hidden + hidden * hidden + hidden + hidden * outputs + outputs;
    size_t count = right + (size_t)longer;
    float *vector = memory(count * sizeof *vector), pose[6], contact[5], jacobian[30];
    fill(vector, count * sizeof *vector, data, size);
    fill(pose, sizeof pose, data, size);
    vector[0] = (float)hidden;
    vector[1] = (float)outputs;
    if (sizes[2] % 4 == 3)
        fill(vector, 2 * sizeof *vector, data, size); // any number may claim to be a size
    fmfts_network view;
    bool accepted = fmfts_view_network(vector, count, &view);
    if (sizes[2] % 4 != 3)
        require(accepted == (longer == 0 && hidden >= 1 && hidden <= 256 && outputs >= 1 && outputs <= 5),
                "a network is accepted if, and only if, its size is that of its head");
    if (accepted)
        fmfts_infer(&view, pose, contact, jacobian);
    free(vector);
}

static bool is_positive(double value)
{
    return value > 0.0 && isfinite(value);
}

static void response(const uint8_t *sizes, int longer, const uint8_t *data, size_t size)
{
    enum { NUMBERS = 9 };
    size_t knots_x = sizes[0] % 6, knots_y = sizes[1] % 6, monomials = sizes[2] % 18, loads = sizes[3] % 5;
    size_t coefficients = (knots_x + 2) * (knots_y + 2) * monomials * 5, exponents = monomials * loads;
    size_t bytes = (NUMBERS + coefficients) * sizeof(double) + exponents * sizeof(int32_t);
    size_t count = bytes + (size_t)longer * sizeof(int32_t);
    if (count < NUMBERS * sizeof(double))
        return; // the numbers below would not fit
    double *table = memory(count), change[5], covariance[25], press[5] = {0}, spread[25], chi2;
    fill(table, count, data, size);
    const double shape[] = {(double)knots_x, (double)knots_y, (double)monomials, (double)loads};
    memcpy(table, shape, sizeof shape);
    if (sizes[0] & 128) // a correct table, or else any number
        memcpy(table + 4, (const double[]){-5.0, -5.0, 1.5, 1.5, 2.0}, 5 * sizeof(double));
    bool good = longer == 0 && knots_x >= 2 && knots_y >= 2 && monomials >= 1 && monomials <= 16 && loads >= 1 && loads <= 3;
    good = good && is_positive(table[6]) && is_positive(table[7]) && is_positive(table[8]);
    for (size_t i = 0; longer == 0 && i < exponents; i++) {
        int32_t exponent = size ? data[i % size] % 11 - (sizes[1] & 128 ? 1 : 0) : 0;
        memcpy((uint8_t *)(table + NUMBERS + coefficients) + i * sizeof exponent, &exponent, sizeof exponent);
        good = good && exponent >= 0 && exponent <= 9;
    }
    fmfts_response view;
    require(fmfts_view_response(table, count, &view) == good, "a response is accepted if, and only if, it is whole");
    if (good) {
        fill(change, sizeof change, data, size);
        fill(press, sizeof press, data, size);
        memset(covariance, 0, sizeof covariance);
        for (int i = 0; i < 5; i++)
            covariance[6 * i] = size % 2 ? 1e-6 : change[i];
        const fmfts_press_search search = {.change = change, .covariance = covariance, .steps = STEPS, .shear_share = size % 3 ? 0.0 : 0.3};
        bool refined = fmfts_refine(&view, &search, press, spread, &chi2);
        bool is_finite = isfinite(table[4] + 8.0 * table[6]) && isfinite(table[5] + 8.0 * table[7]);
        if (refined && is_finite)
            require(isfinite(press[0]) && isfinite(press[1]), "a press stays on a finite table");
    }
    free(table);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size < HEAD)
        return 0;
    int longer = data[0] / 2 % 4 == 1 ? -1 : data[0] / 2 % 4 == 2 ? 1 : 0;
    (data[0] % 2 ? network : response)(data + 1, longer, data + HEAD, size - HEAD);
    return 0;
}
