/* The line of a board's clock: DeviceClock of clock.py, whose sums these are, in the same order. No allocation, no globals. */
#ifndef FMFTS_CLOCK_H
#define FMFTS_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

enum { FMFTS_SLOPE_BUCKETS = 128 };

/* Since the origin: device time in µs, and arrival in ns less 1000 × device time. */
typedef struct {
    int64_t us, ns;
} fmfts_packet;

/* As DeviceClock.line packs it: what packets teach, the limits of clock.py, and the lowest packets of the last buckets. */
typedef struct {
    int64_t newest_us;
    fmfts_packet lowest, origin; /* the lowest of this bucket; origin: absolute */
    int64_t bucket_end_us, late_packets, late_ns;
    double least_late_ns, height_ns, slope_ns_per_us;
    int64_t fixed_delay_ns, bucket_us, standstill_ns, standstill_packets, height_buckets;
    double jump_ns, tolerance_ns_per_us;
    int64_t minima;
    fmfts_packet minimum[FMFTS_SLOPE_BUCKETS];
} fmfts_clock_line;

/* The host's time of `device_us`, learning from its arrival. False, and nothing learnt, where only Python can judge: before
 * the first packet, after a reset, and where the board's clock has stood still. */
bool fmfts_host_time(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, int64_t *host_ns);

#endif
