/* Products of columns with each other, four by four: what the covariance and the scan spend most of their time on. */
#ifndef FMFTS_GRAM_H
#define FMFTS_GRAM_H

#include <stddef.h>
#include <string.h>

#include "several.h"

/* Two doubles in one register, which every processor has; the compiler does not vectorise this by itself. */
typedef double fmfts_two __attribute__((vector_size(16)));

static inline fmfts_two fmfts_load_two(const double *from)
{
    fmfts_two two;
    memcpy(&two, from, sizeof two);
    return two;
}

/* sum[i][j] = Σ_k a[k · a_stride + i] · b[k · b_stride + j], added up from k = 0. */
static inline void fmfts_gram(size_t count, const double *a, size_t a_stride, const double *b, size_t b_stride,
                              double sum[FMFTS_LANES][FMFTS_LANES])
{
    fmfts_two left[FMFTS_LANES] = {{0.0, 0.0}}, right[FMFTS_LANES] = {{0.0, 0.0}};
    for (size_t k = 0; k < count; k++) {
        fmfts_two b_left = fmfts_load_two(b + k * b_stride), b_right = fmfts_load_two(b + k * b_stride + 2);
        for (int i = 0; i < FMFTS_LANES; i++) {
            fmfts_two one = {a[k * a_stride + i], a[k * a_stride + i]};
            left[i] += one * b_left;
            right[i] += one * b_right;
        }
    }
    for (int i = 0; i < FMFTS_LANES; i++) {
        memcpy(sum[i], &left[i], sizeof left[i]);
        memcpy(sum[i] + 2, &right[i], sizeof right[i]);
    }
}

#endif
