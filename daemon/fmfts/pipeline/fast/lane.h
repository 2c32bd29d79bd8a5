/* One pad's lane: turns each healthy frame into its message, as long as the message has a template. */
#ifndef FMFTS_FAST_LANE_H
#define FMFTS_FAST_LANE_H

#include "../../sensor/wire/clock.h"
#include "frame_step.h"

enum {
    FMFTS_CHANGES = 8,   /* so many changes may wait for Python */
    FMFTS_TALLIED = 256, /* the most frames before Python must look */
    FMFTS_KINDS = FMFTS_NO_NUMBER,
};

/* What becomes of a packet: Python must read it; its message is written; it is left out because it is overdue; or it is a
 * sample before its frame that tells nothing. */
typedef enum { FMFTS_FOR_PYTHON, FMFTS_WRITTEN, FMFTS_OVERDUE, FMFTS_SILENT } fmfts_verdict;

/* A message of `size` bytes. place: offsets of its integers and numbers, see message.c. */
typedef struct {
    uint8_t *text; /* NULL: no template */
    size_t size;
    const int32_t *place;
} fmfts_template;

/* One pad. Python owns what the pointers refer to, and does not touch it while the lane is begun, but for the sightings of
 * other pads. All of it runs in one thread. */
typedef struct {
    fmfts_pad pad;
    fmfts_memory *memory;
    fmfts_outcome *outcome;
    fmfts_clock_line *clock;
    unsigned pad_index;
    int64_t overdue_ns; /* a frame that is older is not published */
    fmfts_template message[FMFTS_KINDS];
    fmfts_kind kind; /* of the last message; message[kind].text holds that message */
    uint64_t number;
    /* Copies [FMFTS_CHANGES][change_room] of the messages whose kind differs from the one before: Python reports them. */
    uint8_t *change;
    size_t change_room, change_bytes[FMFTS_CHANGES], changes;
    /* The frames handled since the lane was begun: their number, the first one's sequence, and the last one's values. */
    size_t passed;
    uint32_t first_sequence, sequence;
    int64_t arrival_ns, t_sample_ns, t_publish_ns, t_now_ns;
    int64_t frame_us, frame_ns; /* of the last frame, also before the lane was begun: the board's time, and the host's */
    size_t early;               /* messages of samples before their frames since then */
    double latency_s[FMFTS_TALLIED];
} fmfts_lane;

/* The time of CLOCK_MONOTONIC or CLOCK_REALTIME. */
int64_t fmfts_now_ns(int clock);

/* Handles one packet, without its closing zero. It is for Python, and nothing changes, if it is neither a healthy frame of this
 * pad nor one of its samples before a frame, or if the kind of message changes and there is no room to tell of it. */
fmfts_verdict fmfts_handle_line(fmfts_lane *lane, const uint8_t *line, size_t size, int64_t arrival_ns);

#endif
