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
    int64_t frame_us; /* time of the frame itself, if it has one */
} fmfts_pushed;

/* After a longer gap than this (or the time after which a chip counts as stopped, at low rates) the earlier samples do
 * not determine the motion since: a line from them to the next sample would be as uncertain as the whole movement of
 * the pad in the gap. */
#define FMFTS_LONGEST_GAP_US 300000.0
/* A chip that is this many periods behind the others has stopped: the others do not wait for it. */
#define FMFTS_STOPPED_PERIODS 2.5
/* A sample jumps if it is half a gauss off the line through the two before. A tap of 1 N in 50 ms is 0.05 gauss off. */
#define FMFTS_JUMP_T 5e-5

/* stopped_us: a chip that is this far behind the others has stopped. old_us: the largest age of the newest sample of
 * all. */
typedef struct {
    double stopped_us, longest_gap_us, old_us;
} fmfts_periods;

/* As Aligned; the caller provides the arrays [sensors][3], and noise_share [sensors]. */
typedef struct {
    double *field_t, *noise_share, *bend_t;
    int64_t time_us, *repeats;
    bool is_old, began_anew;
} fmfts_aligned;

/* Of the frame before: its time on the board's clock, and the host's time and the number of the first frame with that time, as the
 * board's clock may stand. stood_ns: 0 before any frame. */
typedef struct {
    int64_t frame_us, stood_ns, stood_sequence;
} fmfts_last;

/* The jump of the board's clock between the last frame and this one, beyond the time that passed. */
int64_t fmfts_leap_us(const fmfts_last *last, int64_t frame_us, int64_t host_ns, int64_t sequence, double period_us);

/* There is at least one sensor. */
void fmfts_push(const fmfts_periods *periods, fmfts_samples *samples, const fmfts_pushed *frame, fmfts_aligned *aligned);

fmfts_periods fmfts_periods_of(double period_us);

/* The time of the newest of `count` samples. */
int64_t fmfts_latest(size_t count, const int64_t *time_us);

#endif
