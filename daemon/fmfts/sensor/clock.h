/* The line of a board's clock, where it stays as it is: clock.py. No allocation, no globals. */
#ifndef FMFTS_CLOCK_H
#define FMFTS_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

/* As DeviceClock.line packs it. What packets teach: the newest, the lowest of this bucket (since the origin, in µs and ns),
 * and how many were late in a row, since when, and how late at least. What holds meanwhile: the line, where its bucket ends
 * (since the origin), and the limits of clock.py. */
typedef struct {
    int64_t newest_us, lowest_us, lowest_ns, late_packets, late_since_ns;
    double least_late_ns;
    int64_t origin_us, origin_ns, bucket_end_us, fixed_delay_ns, standstill_ns, standstill_packets;
    double height_ns, slope_ns_per_us, jump_ns, unsure_ns_per_us;
} fmfts_clock_line;

/* The host's time of `device_us`; false where the packet moves the line, or is later than a clock may stand still. */
bool fmfts_host_time(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, int64_t *host_ns);

/* Learns of a packet that was mapped so. */
void fmfts_heard(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns);

#endif
