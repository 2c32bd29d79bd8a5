/* From aligned samples to the change of the magnets' field since rest. */
#ifndef FMFTS_SINCE_REST_H
#define FMFTS_SINCE_REST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Of each value, three for each sensor; noise_share: of each sensor. foreign_t, now_t: NULL: nothing. gain, offset_t, noise_t,
 * rest_t: of the mounting. recent_t, now_t: by how much fingers changed the field, and change it now. */
typedef struct {
    const double *field_t, *noise_share, *bend_t, *gain, *offset_t, *noise_t, *rest_t, *foreign_t, *recent_t, *now_t;
    const uint8_t *there;
} fmfts_rest_samples;

/* since_rest.c: moment: factor on all moments. creep: by which share of its force the silicone may have crept. */
void fmfts_since_rest(size_t values, const fmfts_rest_samples *samples, double moment, double creep, double *change_t,
                      double *variance_t2);

/* since_rest.c: there [values]: 1 where a value is finite, and repeated no more often than a healthy axis does. Whether all are. */
bool fmfts_list_present(size_t values, const double *field_t, const int64_t *repeats, const double *allowed, uint8_t *there);

#endif
