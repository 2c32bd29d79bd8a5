/* From aligned samples to the change of the magnets' field since rest. */
#ifndef FMFTS_SINCE_REST_H
#define FMFTS_SINCE_REST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Of each value, three for each sensor; noise_share: of each sensor. foreign_t, now_t: NULL: nothing. gain, offset_t, noise_t,
 * rest_t: of the mounting. allowed: how often a healthy axis repeats a value. now_t: by how much fingers change the field now. moment:
 * factor on all moments. creep: by which share of its force the silicone may have crept. decay: divides what is left of presses. */
typedef struct {
    const double *field_t, *noise_share, *bend_t, *gain, *offset_t, *noise_t, *rest_t, *foreign_t, *now_t, *allowed;
    const int64_t *repeats;
    double moment, creep, decay;
} fmfts_rest_samples;

/* recent_t: by how much fingers changed the field; it decays. there: 1 where a value is finite, and repeated no more often than
 * allowed. */
typedef struct {
    double *recent_t, *change_t, *variance_t2;
    uint8_t *there;
} fmfts_rest_change;

/* rest: gain, offset, noise, field and allowed repeats, [values] each; factors: moment, creep and decay. */
static inline fmfts_rest_samples fmfts_samples_of(size_t values, const double *rest, const double factors[3])
{
    return (fmfts_rest_samples){
        .gain = rest,
        .offset_t = rest + values,
        .noise_t = rest + 2 * values,
        .rest_t = rest + 3 * values,
        .allowed = rest + 4 * values,
        .moment = factors[0],
        .creep = factors[1],
        .decay = factors[2],
    };
}

/* since_rest.c: whether the time of the last change of field is unknown for a sample of any axis. */
bool fmfts_since_rest(size_t values, const fmfts_rest_samples *samples, const fmfts_rest_change *found);

#endif
