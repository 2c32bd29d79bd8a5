/* DeviceClock.to_host_ns of a packet that moves nothing: the same sums in the same order. */
#include "clock.h"

/* Since the origin: DeviceClock._point. */
typedef struct {
    int64_t us, ns;
} point;

static point point_of(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    return (point){device_us - line->origin_us, arrival_ns - 1000 * device_us - line->origin_ns};
}

static double above_line(const fmfts_clock_line *line, point p)
{
    return (double)p.ns - line->height_ns - line->slope_ns_per_us * (double)p.us;
}

bool fmfts_host_time(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, int64_t *host_ns)
{
    if ((double)(1000 * (line->newest_us - device_us)) >= line->jump_ns || device_us >= line->until_us) {
        return false;
    }
    double above = above_line(line, point_of(line, device_us, arrival_ns));
    if (!(above >= 1.0 && above <= line->jump_ns)) { /* less than a nanosecond is on it */
        return false;
    }
    *host_ns = arrival_ns - (int64_t)above - line->fixed_delay_ns;
    return true;
}

void fmfts_heard(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    point p = point_of(line, device_us, arrival_ns), lowest = {line->lowest_us, line->lowest_ns};
    if (lowest.us < p.us && above_line(line, p) < above_line(line, lowest)) {
        line->lowest_us = p.us;
        line->lowest_ns = p.ns;
    }
    if (device_us > line->newest_us) {
        line->newest_us = device_us;
    }
}
