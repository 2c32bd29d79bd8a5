/* DeviceClock.to_host_ns: the same sums in the same order. */
#include "clock.h"

#include <math.h>
#include <string.h>

/* The longest time between minima: then products of two differences fit into 64 bits. Python's integers have no limit. */
enum { LONGEST_SPAN_US = 100000000 };

static double above_line(const fmfts_clock_line *line, const fmfts_packet *p)
{
    return (double)p->ns - line->height_ns - line->slope_ns_per_us * (double)p->us;
}

static double unsure_ns(const fmfts_clock_line *line, const fmfts_packet *p)
{
    int64_t since_us = p->us - line->lowest.us;
    return line->jump_ns + line->tolerance_ns_per_us * (double)(since_us > 0 ? since_us : 0);
}

static bool turns_down(const fmfts_packet *a, const fmfts_packet *b, const fmfts_packet *c)
{
    return (b->ns - a->ns) * (c->us - a->us) >= (c->ns - a->ns) * (b->us - a->us);
}

/* Slope of the edge of the lower convex hull that contains the mean time of the points. */
static double hull_slope(const fmfts_packet *point, int64_t count)
{
    fmfts_packet hull[FMFTS_SLOPE_BUCKETS];
    int64_t corners = 0, sum_us = 0;
    for (int64_t i = 0; i < count; i++) {
        while (corners > 1 && turns_down(&hull[corners - 2], &hull[corners - 1], &point[i])) {
            corners--;
        }
        hull[corners++] = point[i];
        sum_us += point[i].us;
    }
    double mean_us = (double)sum_us / (double)count;
    for (int64_t i = 1; i < corners; i++) {
        if ((double)hull[i].us >= mean_us) {
            return (double)(hull[i].ns - hull[i - 1].ns) / (double)(hull[i].us - hull[i - 1].us);
        }
    }
    return 0.0;
}

static void close_bucket(fmfts_clock_line *line, const fmfts_packet *first)
{
    if (line->minima == FMFTS_SLOPE_BUCKETS) {
        memmove(line->minimum, line->minimum + 1, (FMFTS_SLOPE_BUCKETS - 1) * sizeof *line->minimum);
        line->minima--;
    }
    line->minimum[line->minima++] = line->lowest;
    line->bucket_end_us = (first->us / line->bucket_us + 1) * line->bucket_us;
    line->lowest = *first;
    double limit = line->tolerance_ns_per_us, slope = hull_slope(line->minimum, line->minima);
    line->slope_ns_per_us = fmin(limit, fmax(-limit, slope));
    int64_t recent = line->minima - line->height_buckets;
    line->height_ns = INFINITY;
    for (int64_t i = recent > 0 ? recent : 0; i < line->minima; i++) {
        line->height_ns = fmin(line->height_ns,
                               (double)line->minimum[i].ns - line->slope_ns_per_us * (double)line->minimum[i].us);
    }
}

static void learn(fmfts_clock_line *line, const fmfts_packet *p)
{
    if (p->us >= line->bucket_end_us) {
        close_bucket(line, p);
    } else if (line->lowest.us < p->us && above_line(line, p) < above_line(line, &line->lowest)) {
        line->lowest = *p;
    }
    line->height_ns = fmin(line->height_ns, (double)p->ns - line->slope_ns_per_us * (double)p->us);
}

/* How long the packet may have waited because the host did not read. */
static double unread_ns(const fmfts_clock_line *line, int64_t arrival_ns)
{
    return line->empty_ns ? (double)(arrival_ns - line->empty_ns) : 0.0;
}

/* Whether a late packet counts toward a standstill of the clock: not if it belongs to the burst of the last one. */
static bool is_another_late(const fmfts_clock_line *line, int64_t arrival_ns)
{
    return !line->late_packets || arrival_ns - line->late_ns >= line->standstill_ns / (line->standstill_packets - 1);
}

static bool goes_on(const fmfts_clock_line *line, int64_t device_us, const fmfts_packet *p)
{
    return (double)(1000 * (line->newest_us - device_us)) < line->jump_ns && above_line(line, p) > -unsure_ns(line, p);
}

bool fmfts_is_plausible(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    fmfts_packet p = {device_us - line->origin.us, arrival_ns - 1000 * device_us - line->origin.ns};
    return line->is_host || (line->bucket_end_us && goes_on(line, device_us, &p));
}

bool fmfts_host_time(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, int64_t *host_ns)
{
    if (line->is_host) {
        *host_ns = 1000 * device_us < arrival_ns ? 1000 * device_us : arrival_ns;
        return true;
    }
    if (!line->bucket_end_us) {
        return false; /* no packet yet */
    }
    fmfts_packet p = {device_us - line->origin.us, arrival_ns - 1000 * device_us - line->origin.ns};
    int64_t begun_us = line->minima ? line->minimum[0].us : line->lowest.us;
    double above_ns = above_line(line, &p), unsure = unsure_ns(line, &p);
    if (!goes_on(line, device_us, &p) || p.us < 0 || p.us - begun_us > LONGEST_SPAN_US) {
        return false;
    }
    if (above_ns > unsure && above_ns - unread_ns(line, arrival_ns) <= unsure) {
        /* The host itself may be the cause: the packet says nothing of the board's clock. */
    } else if (above_ns > unsure) {
        bool another = is_another_late(line, arrival_ns);
        if (another && line->late_packets + 1 >= line->standstill_packets) {
            return false;
        }
        line->late_ns = another ? arrival_ns : line->late_ns;
        line->late_packets += another;
        line->least_late_ns = fmin(line->least_late_ns, above_ns);
    } else {
        line->late_ns = line->late_packets = 0;
        line->least_late_ns = INFINITY;
        learn(line, &p);
        above_ns = above_line(line, &p);
    }
    line->newest_us = device_us > line->newest_us ? device_us : line->newest_us;
    *host_ns = arrival_ns - (above_ns > 0.0 ? (int64_t)above_ns : 0) - line->fixed_delay_ns;
    return true;
}
