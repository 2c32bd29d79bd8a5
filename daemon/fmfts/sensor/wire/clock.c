#include "clock.h"

#include <math.h>
#include <string.h>

enum {
    BUCKET_US = 250000,
    HEIGHT_BUCKETS = 16, /* 4 s: longer than a short stall of the host, so short that an error of the slope does not matter */
    /* Only late packets for so long: the board's clock stood still. At a few Hz two late packets in a row may be chance, and a backlog
     * comes in a few bursts. So a standstill needs this many late packets, each this long after the last one that counted. */
    STANDSTILL_NS = 400000000,
    STANDSTILL_PACKETS = 8,
    LATE_APART_NS = STANDSTILL_NS / (STANDSTILL_PACKETS - 1),
    /* Older minima are useless for the present slope; and products of two differences fit into 64 bits. */
    LONGEST_SPAN_US = 100000000,
};

static fmfts_packet packet_of(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    return (fmfts_packet){device_us - line->origin.us, arrival_ns - 1000 * device_us - line->origin.ns};
}

static double above(const fmfts_clock_line *line, const fmfts_packet *p)
{
    return (double)p->ns - line->height_ns - line->slope_ns_per_us * (double)p->us;
}

/* How wrong the line may be: the slope may be off by the tolerance since the lowest packet of this bucket. */
static double unsure_ns(const fmfts_clock_line *line, const fmfts_packet *p)
{
    int64_t since_us = p->us - line->lowest.us;
    return FMFTS_JUMP_NS + line->tolerance_ns_per_us * fmin(fmax((double)since_us, 0.0), LONGEST_SPAN_US);
}

static void forget_late(fmfts_clock_line *line)
{
    line->late_ns = line->late_packets = 0;
    line->least_late_ns = INFINITY;
}

void fmfts_restart_clock(fmfts_clock_line *line)
{
    line->begun = line->newest_us = line->bucket_end_us = line->minima = 0;
    line->height_ns = line->slope_ns_per_us = 0.0;
    line->origin = line->lowest = (fmfts_packet){0, 0};
    forget_late(line);
}

bool fmfts_goes_on(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    fmfts_packet p = packet_of(line, device_us, arrival_ns);
    return line->is_host || !line->begun ||
           ((double)(1000 * (line->newest_us - device_us)) < FMFTS_JUMP_NS && above(line, &p) > -unsure_ns(line, &p));
}

double fmfts_above_line(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    fmfts_packet p = packet_of(line, device_us, arrival_ns);
    return above(line, &p);
}

static bool turns_down(const fmfts_packet *a, const fmfts_packet *b, const fmfts_packet *c)
{
    return (b->ns - a->ns) * (c->us - a->us) >= (c->ns - a->ns) * (b->us - a->us);
}

/* Slope of the edge of the lower convex hull that contains the mean time of the points; 0 for a single point. */
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

/* Adds the lowest packet of the bucket to the minima, and drops minima that are too old. */
static void keep_lowest(fmfts_clock_line *line)
{
    int64_t old = line->minima == FMFTS_SLOPE_BUCKETS;
    while (old < line->minima && line->lowest.us - line->minimum[old].us > LONGEST_SPAN_US) {
        old++;
    }
    line->minima -= old;
    memmove(line->minimum, line->minimum + old, (size_t)line->minima * sizeof *line->minimum);
    line->minimum[line->minima++] = line->lowest;
}

static void close_bucket(fmfts_clock_line *line, const fmfts_packet *first)
{
    keep_lowest(line);
    line->bucket_end_us = (first->us / BUCKET_US + 1) * BUCKET_US;
    line->lowest = *first;
    double limit = line->tolerance_ns_per_us, slope = hull_slope(line->minimum, line->minima);
    line->slope_ns_per_us = fmin(limit, fmax(-limit, slope));
    int64_t recent = line->minima - HEIGHT_BUCKETS;
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
    } else if (line->lowest.us < p->us && above(line, p) < above(line, &line->lowest)) {
        line->lowest = *p;
    }
    line->height_ns = fmin(line->height_ns, (double)p->ns - line->slope_ns_per_us * (double)p->us);
}

/* When only late packets came for long enough, moves the line up by the delay of the least late one. */
static void note_late(fmfts_clock_line *line, const fmfts_packet *p, int64_t arrival_ns)
{
    line->least_late_ns = fmin(line->least_late_ns, above(line, p));
    if (line->late_packets && arrival_ns - line->late_ns < LATE_APART_NS) {
        return; /* belongs to the burst of the last late packet */
    }
    line->late_packets++;
    line->late_ns = arrival_ns;
    if (line->late_packets < STANDSTILL_PACKETS) {
        return;
    }
    int64_t step_ns = (int64_t)line->least_late_ns;
    for (int64_t i = 0; i < line->minima; i++) {
        line->minimum[i].ns += step_ns;
    }
    line->lowest.ns += step_ns;
    line->height_ns += (double)step_ns;
    forget_late(line);
    if (above(line, p) <= unsure_ns(line, p)) { /* otherwise it is later than another late packet */
        learn(line, p);
    }
}

/* How long the packet may have waited because the host did not read; 0 if that was never reported. */
static double unread_ns(const fmfts_clock_line *line, int64_t arrival_ns)
{
    return line->empty_ns ? (double)(arrival_ns - line->empty_ns) : 0.0;
}

static void begin(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    line->begun = 1;
    line->origin = (fmfts_packet){device_us, arrival_ns - 1000 * device_us};
    line->newest_us = device_us;
    line->bucket_end_us = BUCKET_US;
}

int64_t fmfts_host_time(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns)
{
    if (line->is_host) {
        return 1000 * device_us < arrival_ns ? 1000 * device_us : arrival_ns;
    }
    bool was_silent = line->begun && device_us - line->newest_us > LONGEST_SPAN_US;
    if (was_silent || !fmfts_goes_on(line, device_us, arrival_ns)) {
        fmfts_restart_clock(line);
    }
    if (!line->begun) {
        begin(line, device_us, arrival_ns);
    }
    fmfts_packet p = packet_of(line, device_us, arrival_ns);
    double above_ns = above(line, &p), unsure = unsure_ns(line, &p);
    if (above_ns > unsure && above_ns - unread_ns(line, arrival_ns) <= unsure) {
        /* The host itself may be the cause, so the packet is no evidence about the board's clock. */
    } else if (above_ns > unsure) {
        note_late(line, &p, arrival_ns);
    } else {
        forget_late(line);
        learn(line, &p);
    }
    above_ns = above(line, &p);
    line->newest_us = device_us > line->newest_us ? device_us : line->newest_us;
    return arrival_ns - (above_ns > 0.0 ? (int64_t)above_ns : 0) - line->fixed_delay_ns;
}
