/* Products of columns with each other, four by four: what the covariance and the scan spend most of their time on. */
#ifndef FMFTS_GRAM_H
#define FMFTS_GRAM_H

#include <stddef.h>
#include <string.h>

#include "../arithmetic/wide.h"

/* sum[i][j] = Σ_k a[k · a_stride + i] · b[k · b_stride + j], added up from k = 0. */
static inline void fmfts_gram(size_t count, const double *a, size_t a_stride, const double *b, size_t b_stride,
                              double sum[FMFTS_LANES][FMFTS_LANES])
{
    fmfts_four row[FMFTS_LANES] = {{0.0}}, four;
    for (size_t k = 0; k < count; k++) {
        memcpy(&four, b + k * b_stride, sizeof four);
        for (int i = 0; i < FMFTS_LANES; i++) {
            row[i] += a[k * a_stride + i] * four;
        }
    }
    memcpy(sum, row, sizeof row);
}

#endif
