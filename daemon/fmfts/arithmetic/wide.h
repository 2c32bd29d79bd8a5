/* Functions that are compiled twice: for every processor, and for those with vectors of four doubles. The order of each sum is the
 * same, and products are not fused with sums, so that both give the same bits. */
#ifndef FMFTS_WIDE_H
#define FMFTS_WIDE_H

#include <limits.h> /* defines __GLIBC__, whose loader chooses one */

#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define FMFTS_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define FMFTS_WIDE
#endif

/* Four doubles: one register or two. The compiler does not vectorise sums that stay in registers by itself. */
enum { FMFTS_LANES = 4 };
typedef double fmfts_four __attribute__((vector_size(FMFTS_LANES * sizeof(double))));

#endif
