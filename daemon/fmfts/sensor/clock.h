/* The line of a board's clock, where it stays as it is: clock.py. No allocation, no globals. */
#ifndef FMFTS_CLOCK_H
#define FMFTS_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

/* As DeviceClock.line packs it. The line is origin, height and slope. A packet of a device's time before `until`, and not
 * a jump before the newest, teaches nothing if it arrives at least `least_above` and at most a jump above it. */
typedef struct {
    int64_t origin_us, origin_ns, newest_us, until_us, fixed_delay_ns;
    double height_ns, slope_ns_per_us, least_above_ns, jump_ns;
} fmfts_clock_line;

/* The host's time of `device_us`; false where the packet teaches the clock something. */
bool fmfts_host_time(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, int64_t *host_ns);

/* A packet of that time was mapped so. */
void fmfts_heard(fmfts_clock_line *line, int64_t device_us);

#endif
