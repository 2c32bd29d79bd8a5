/* DeviceClock.to_host_ns of a packet that does not move the line: the same sums in the same order. */
#include "clock.h"

#include <math.h>

/* A packet as clock.py sees it: since the origin, and above the line. */
typedef struct {
    int64_t us, ns;
    double above_ns;
} packet;

static double above_line(const fmfts_clock_line *line, int64_t us, int64_t ns)
{
    return (double)ns - line->height_ns - line->slope_ns_per_us * (double)us;
}

static packet packet_of(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    int64_t us = device_us - line->origin_us, ns = arrival_ns - 1000 * device_us - line->origin_ns;
    return (packet){us, ns, above_line(line, us, ns)};
}

static bool is_late(const fmfts_clock_line *line, const packet *p)
{
    return p->above_ns > line->jump_ns + line->unsure_ns_per_us * fmax((double)(p->us - line->lowest_us), 0.0);
}

bool fmfts_host_time(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, int64_t *host_ns)
{
    packet p = packet_of(line, device_us, arrival_ns);
    /* Less than a nanosecond above is on the line. */
    if ((double)(1000 * (line->newest_us - device_us)) >= line->jump_ns || !(p.above_ns >= 1.0) ||
        p.above_ns > (double)line->standstill_ns) {
        return false;
    }
    if (is_late(line, &p)) {
        bool lasted = line->late_packets > 0 && arrival_ns - line->late_since_ns >= line->standstill_ns;
        if (lasted && line->late_packets + 1 >= line->standstill_packets) {
            return false;
        }
    } else if (p.us >= line->bucket_end_us) {
        return false;
    }
    *host_ns = arrival_ns - (int64_t)p.above_ns - line->fixed_delay_ns;
    return true;
}

void fmfts_heard(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    packet p = packet_of(line, device_us, arrival_ns);
    if (device_us > line->newest_us) {
        line->newest_us = device_us;
    }
    if (is_late(line, &p)) {
        line->late_since_ns = line->late_packets ? line->late_since_ns : arrival_ns;
        line->late_packets++;
        line->least_late_ns = fmin(line->least_late_ns, p.above_ns);
        return;
    }
    line->late_since_ns = line->late_packets = 0;
    line->least_late_ns = INFINITY;
    if (line->lowest_us < p.us && p.above_ns < above_line(line, line->lowest_us, line->lowest_ns)) {
        line->lowest_us = p.us;
        line->lowest_ns = p.ns;
    }
}
