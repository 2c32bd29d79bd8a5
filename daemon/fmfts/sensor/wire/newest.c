/* keep_newest of newest.py. */
#define _GNU_SOURCE /* memrchr */
#include "newest.h"

#include <stdbool.h>
#include <string.h>

typedef struct {
    unsigned kept[FMFTS_WIRE_PADS];
    uint64_t newest_us[FMFTS_WIRE_PADS];
} seen_pads;

/* Lines come from the last to the first. */
static bool is_superseded(const uint8_t *line, size_t size, fmfts_patience patience, seen_pads *seen, unsigned *left_out)
{
    fmfts_sample sample;
    if (!fmfts_read_sample(line, size, &sample) || sample.pad_index >= FMFTS_WIRE_PADS) {
        return false;
    }
    unsigned pad = sample.pad_index;
    if (seen->kept[pad] == 0 || sample.time_us > seen->newest_us[pad]) {
        seen->newest_us[pad] = sample.time_us; /* what follows this sample is old, and was sent again */
        seen->kept[pad] = 0;
    }
    uint64_t age_us = seen->newest_us[pad] - sample.time_us;
    if (seen->kept[pad] && (seen->kept[pad] >= patience.most || age_us > patience.longest_us)) {
        left_out[pad]++;
        return true;
    }
    seen->kept[pad]++;
    return false;
}

size_t fmfts_keep_newest(uint8_t *bytes, size_t size, fmfts_patience patience, unsigned left_out[FMFTS_WIRE_PADS])
{
    seen_pads seen = {{0}, {0}};
    uint8_t *last_zero = memrchr(bytes, 0, size);
    if (!last_zero || memchr(bytes, 0, size) == last_zero) {
        return size; /* at most one line */
    }
    /* What stays is moved to the end of `bytes`, and at last to their beginning. */
    uint8_t *end = last_zero + 1, *stays = end;
    while (end > bytes) {
        size_t before = (size_t)(end - 1 - bytes);
        uint8_t *zero = before ? memrchr(bytes, 0, before) : NULL;
        uint8_t *line = zero ? zero + 1 : bytes;
        if (!is_superseded(line, (size_t)(end - 1 - line), patience, &seen, left_out)) {
            stays -= end - line;
            memmove(stays, line, (size_t)(end - line));
        }
        end = line;
    }
    size_t stay = (size_t)(bytes + size - stays);
    memmove(bytes, stays, stay);
    return stay;
}
