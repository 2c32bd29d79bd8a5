/* Drops samples that newer ones of the same pad supersede: newest.py explains when. No allocation, no globals. */
#ifndef FMFTS_NEWEST_H
#define FMFTS_NEWEST_H

#include <stddef.h>
#include <stdint.h>

#include "sample.h"

/* Patience of patience.py: the most samples of one pad that stay, and their largest age against the newest. */
typedef struct {
    unsigned most;
    int64_t longest_us;
} fmfts_patience;

/* Removes superseded samples and early samples from the complete lines in `bytes`, and counts the samples by pad: an
 * early sample that was left out is in the next frame. Returns the new size. All other bytes stay, in their order. */
size_t fmfts_keep_newest(uint8_t *bytes, size_t size, fmfts_patience patience, unsigned left_out[FMFTS_WIRE_PADS]);

#endif
