/* keep_newest of newest.py. */
#define _GNU_SOURCE /* memrchr */
#include "newest.h"

#include <stdbool.h>
#include <string.h>

/* Of one kind of packets: how many stay, and the time of the newest. */
typedef struct {
    unsigned kept;
    uint64_t newest_us;
} kind;

typedef struct {
    kind frames[FMFTS_WIRE_PADS], early[FMFTS_WIRE_PADS][FMFTS_SENSORS];
} seen_packets;

/* Whether a packet of this time is superseded by those that follow it. */
static bool is_superseded_in(kind *own, uint64_t time_us, fmfts_patience patience)
{
    if (own->kept == 0 || time_us > own->newest_us) {
        own->newest_us = time_us; /* the packets after this one are old, and were sent again */
        own->kept = 0;
    }
    uint64_t age_us = own->newest_us - time_us;
    if (own->kept && (own->kept >= patience.most || age_us > (uint64_t)patience.longest_us)) {
        return true;
    }
    own->kept++;
    return false;
}

/* Lines come from the last to the first. */
static bool is_superseded(const uint8_t *line, size_t size, fmfts_patience patience, seen_packets *seen, unsigned *left_out)
{
    fmfts_sample sample;
    fmfts_early_sample early;
    if (fmfts_read_sample(line, size, &sample) && sample.pad_index < FMFTS_WIRE_PADS) {
        bool superseded = is_superseded_in(&seen->frames[sample.pad_index], sample.time_us, patience);
        left_out[sample.pad_index] += superseded;
        return superseded;
    }
    if (fmfts_read_early_sample(line, size, &early) && early.pad_index < FMFTS_WIRE_PADS) {
        /* A frame holds all that came before it. */
        return seen->frames[early.pad_index].kept >= patience.most ||
               is_superseded_in(&seen->early[early.pad_index][early.sensor], early.time_us, patience);
    }
    return false;
}

size_t fmfts_keep_newest(uint8_t *bytes, size_t size, fmfts_patience patience, unsigned left_out[FMFTS_WIRE_PADS])
{
    seen_packets seen = {.frames = {{0}}};
    uint8_t *last_zero = memrchr(bytes, 0, size);
    if (!last_zero || memchr(bytes, 0, size) == last_zero) {
        return size; /* at most one line */
    }
    /* The remaining lines are moved to the end of `bytes`, and finally to their beginning. */
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
