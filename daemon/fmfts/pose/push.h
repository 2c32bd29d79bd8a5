/* Adds the samples of one frame to those before, and interpolates all sensors to one instant: alignment.py explains it. */
#ifndef FMFTS_PUSH_H
#define FMFTS_PUSH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* As AlignmentMemory. field_t [3][sensors][3], time_us [3][sensors], repeats [sensors][3]. */
typedef struct {
    size_t sensors;
    double *field_t;
    int64_t *time_us, *repeats;
    int64_t without_news;
} fmfts_samples;

/* One frame, as Alignment.push takes it. Arrays of all sensors; timed: NULL where all tell their time. */
typedef struct {
    const double *field_t; /* [sensors][3] */
    const int64_t *time_us;
    const uint8_t *fresh, *timed;
    bool has_time;
    int64_t frame_us; /* of the frame itself, if it has one */
} fmfts_pushed;

/* What Alignment knows of the period: see alignment.py. */
typedef struct {
    double stopped_us, longest_gap_us, old_us;
    double gap_share, unseen_share, jump_t;
    int64_t most_without_news;
} fmfts_periods;

/* As Aligned; whoever calls gives the arrays [sensors][3], and noise_share [sensors]. */
typedef struct {
    double *field_t, *noise_share, *bend_t;
    int64_t time_us, *repeats;
    bool is_old, began_anew;
} fmfts_aligned;

/* There is at least one sensor. */
void fmfts_push(const fmfts_periods *periods, fmfts_samples *samples, const fmfts_pushed *frame, fmfts_aligned *aligned);

#endif
