/* The line of a board's clock, where it stays as it is: clock.py. No allocation, no globals. */
#ifndef FMFTS_CLOCK_H
#define FMFTS_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

/* As DeviceClock.line packs it. The line is origin, height and slope; `lowest` is the packet of its bucket that arrived the
 * least above it, in µs and ns since the origin. A packet above the line and of a device's time before `until` teaches no
 * more than that, if it comes at most a jump above, and a jump before the newest. */
typedef struct {
    int64_t newest_us, lowest_us, lowest_ns, origin_us, origin_ns, until_us, fixed_delay_ns;
    double height_ns, slope_ns_per_us, jump_ns;
} fmfts_clock_line;

/* The host's time of `device_us`; false where the packet teaches the clock something else. */
bool fmfts_host_time(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, int64_t *host_ns);

/* Learns of a packet that was mapped so. */
void fmfts_heard(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns);

#endif
