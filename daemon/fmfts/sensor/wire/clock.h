/* Maps a board's microseconds to the host's CLOCK_MONOTONIC: when was a sample taken?
 *
 * The delay of a packet is never negative and often near its minimum. So the map is a line below all points (device time, arrival).
 * Its slope comes from the lower convex hull of the last half minute (Moon, Skelly, Towsley 1999), its height from the earliest
 * arrivals of the last seconds. No host can measure the constant part of the delay; the caller gives the known part as
 * fixed_delay_ns.
 *
 * A packet far above the line is late and changes nothing: after a stall, a host gets its backlog in one burst. If only late packets
 * arrive for a while, the board's clock has stood still, and the line moves up. Packets that may have waited because
 * this host did not read do not count for that: the reader reports when nothing was left unread. No allocation, no
 * globals.
 */
#ifndef FMFTS_CLOCK_H
#define FMFTS_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

/* Pads of one board interleave within a few ms; a larger step is a reset, or a suspended host. */
#define FMFTS_JUMP_NS 20e6

enum { FMFTS_SLOPE_BUCKETS = 128 }; /* 32 s: the drift of a crystal is constant over that, that of an RC oscillator nearly */

/* Device time in µs, and arrival in ns minus 1000 × device time; both since the origin. */
typedef struct {
    int64_t us, ns;
} fmfts_packet;

/* The learned map; 8 bytes each (clock.py). empty_ns: when the host last found no byte unread; 0: never reported.
 * is_host: the device's clock is the host's own. begun: there was a packet. origin: the first one, in absolute times.
 * lowest: of this bucket; minimum: of the last ones, oldest first. The line is height_ns + slope_ns_per_us × us. */
typedef struct {
    int64_t empty_ns, is_host, fixed_delay_ns;
    double tolerance_ns_per_us;
    int64_t begun, newest_us;
    double height_ns, slope_ns_per_us;
    fmfts_packet origin, lowest;
    int64_t bucket_end_us, late_packets, late_ns;
    double least_late_ns;
    int64_t minima;
    fmfts_packet minimum[FMFTS_SLOPE_BUCKETS];
} fmfts_clock_line;

/* Forgets all packets: the board was reset, or its line was closed. */
void fmfts_restart_clock(fmfts_clock_line *line);

/* Whether a packet fits the learned map. The first one does, and every one of the host's own clock. */
bool fmfts_goes_on(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns);

/* How far a packet is above the line, in ns, after the first one. */
double fmfts_above_line(const fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns);

/* The host's time of `device_us`, never later than its arrival; learns from the arrival. A packet that does not go on
 * restarts, and one after 100 s of silence: by then the slope may have changed. */
int64_t fmfts_host_time(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns);

#endif
