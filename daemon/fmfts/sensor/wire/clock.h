/* Maps a board's clock to the host's as DeviceClock of clock.py does, with the same sums in the same order. No
 * allocation, no globals. */
#ifndef FMFTS_CLOCK_H
#define FMFTS_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

enum { FMFTS_SLOPE_BUCKETS = 128 };

/* Device time in µs, and arrival in ns minus 1000 × device time; both since the origin. */
typedef struct {
    int64_t us, ns;
} fmfts_packet;

/* Laid out as DeviceClock.line and HostClock.line: when the host last found no byte unread (0: it never said), whether
 * the device's clock is the host's own; the learned line, the limits of clock.py, and the lowest packets of the last buckets. */
typedef struct {
    int64_t empty_ns, is_host;
    int64_t newest_us;
    fmfts_packet lowest, origin; /* lowest: of this bucket; origin: the first packet, in absolute times */
    int64_t bucket_end_us, late_packets, late_ns;
    double least_late_ns, height_ns, slope_ns_per_us;
    int64_t fixed_delay_ns, bucket_us, standstill_ns, standstill_packets, height_buckets;
    double jump_ns, tolerance_ns_per_us;
    int64_t minima;
    fmfts_packet minimum[FMFTS_SLOPE_BUCKETS];
} fmfts_clock_line;

/* Whether this time goes on from what was learned: DeviceClock.is_plausible. Of the host's own clock every one does. */
bool fmfts_is_plausible(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns);

/* The host's time of `device_us`; learns from its arrival. Returns false and learns nothing when Python must decide:
 * before the first packet, after a reset, and when the board's clock has stood still. */
bool fmfts_host_time(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, int64_t *host_ns);

#endif
