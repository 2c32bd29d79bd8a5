/* DeviceClock.to_host_ns of a packet that teaches nothing: the same sums in the same order. */
#include "clock.h"

bool fmfts_host_time(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, int64_t *host_ns)
{
    if ((double)(1000 * (line->newest_us - device_us)) >= line->jump_ns || device_us >= line->until_us) {
        return false;
    }
    double above = (double)(arrival_ns - 1000 * device_us - line->origin_ns) - line->height_ns -
                   line->slope_ns_per_us * (double)(device_us - line->origin_us);
    if (!(above >= line->least_above_ns && above <= line->jump_ns)) {
        return false;
    }
    *host_ns = arrival_ns - (int64_t)above - line->fixed_delay_ns;
    return true;
}

void fmfts_heard(fmfts_clock_line *line, int64_t device_us)
{
    if (device_us > line->newest_us) {
        line->newest_us = device_us;
    }
}
