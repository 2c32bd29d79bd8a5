/* A frame from the wire to the bus, as long as it is healthy and its message has a template. */
#ifndef FMFTS_EXPRESS_H
#define FMFTS_EXPRESS_H

#include "../../sensor/wire/clock.h"
#include "frame_step.h"

enum {
    FMFTS_TALLIED = 256, /* frames, between two looks of Python */
    FMFTS_KINDS = FMFTS_NO_NUMBER,
};

/* A message of `size` bytes, and where its integers and numbers are: message.c. */
typedef struct {
    uint8_t *text; /* NULL: there is none */
    size_t size;
    const int32_t *place;
} fmfts_template;

/* One pad. What is pointed to is Python's, and nobody else's while frames pass here. */
typedef struct {
    const fmfts_parameters *parameters;
    fmfts_memory *memory;
    fmfts_outcome *outcome;
    const void *response; /* of a model that refines, else NULL */
    size_t response_bytes;
    fmfts_network network;
    fmfts_clock_line *clock;
    unsigned pad_index;
    fmfts_template message[FMFTS_KINDS];
    fmfts_kind kind; /* of the last message, which stands in its template */
    uint64_t number;
    /* The first message of another kind, once there is one: Python has to tell of it. Room for the longest. */
    uint8_t *change;
    size_t change_bytes;
    /* Frames that passed: how many, the first's and the last's. */
    size_t passed;
    uint32_t first_sequence, sequence;
    int64_t arrival_ns, t_sample_ns, t_publish_ns;
    double latency_s[FMFTS_TALLIED];
} fmfts_lane;

/* Of CLOCK_MONOTONIC or CLOCK_REALTIME. */
int64_t fmfts_now_ns(int clock);

/* The line [0, size) of bytes, its closing zero left out. False where it is not a healthy frame of this pad, or of another
 * kind once more: nothing has changed then. */
bool fmfts_express(fmfts_lane *lane, const uint8_t *line, size_t size, int64_t arrival_ns);

#endif
