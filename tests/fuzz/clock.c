// The map from a board's clock to the host's, over packets of any times that the board can count and the host can have.
// After a first byte for the tolerance, pieces of six: flags, a shift for what is flagged, by how much the board's clock goes
// on, and by how much the arrival does beyond that.
#include <math.h>
#include <string.h>

#include "../../daemon/fmfts/sensor/wire/clock.h"
#include "../firmware/fuzz/fuzz.h"

enum { PIECE = 6 };

// The board's clock leaps; the packet is late; so many packets alike; the arrival does not go on with the board's clock; the
// host found no byte unread; Python, where it decides, begins anew.
enum { LEAP = 1, LATE = 2, ALONE = 4, EMPTY = 8, ANEW = 16, OFTEN = 32 };

static const int64_t MOST_US = (INT64_C(1) << 48) - 1, MOST_NS = (INT64_C(1) << 62) - 1;

// As DeviceClock begins with its first packet.
static void begin(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, double tolerance)
{
    memset(line, 0, sizeof *line);
    line->newest_us = device_us;
    line->origin = (fmfts_packet){device_us, arrival_ns - 1000 * device_us};
    line->bucket_us = line->bucket_end_us = 250000;
    line->least_late_ns = INFINITY;
    line->standstill_ns = 400000000;
    line->standstill_packets = 8;
    line->height_buckets = 16;
    line->jump_ns = 20e6;
    line->tolerance_ns_per_us = 1000.0 * tolerance;
}

static int64_t within(int64_t value, int64_t most)
{
    return value < 0 ? 0 : value > most ? most : value;
}

static int64_t step_of(const uint8_t *bytes, unsigned shift)
{
    return (int64_t)(int16_t)(bytes[0] | bytes[1] << 8) * (INT64_C(1) << shift);
}

static void take(fmfts_clock_line *line, int64_t device_us, int64_t arrival_ns, bool anew)
{
    int64_t host_ns;
    bool plausible = fmfts_is_plausible(line, device_us, arrival_ns);
    if (fmfts_host_time(line, device_us, arrival_ns, &host_ns)) {
        require(plausible, "no time is used that does not go on from what was learned");
        require(host_ns <= arrival_ns, "no sample was taken after it arrived");
    } else if (anew || !plausible) {
        begin(line, device_us, arrival_ns, line->tolerance_ns_per_us / 1000.0);
    }
    require(line->minima >= 0 && line->minima <= FMFTS_SLOPE_BUCKETS, "minima have places");
    require(isfinite(line->height_ns) && fabs(line->slope_ns_per_us) <= line->tolerance_ns_per_us, "the line is one");
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fmfts_clock_line line;
    int64_t device_us = 1000000, arrival_ns = 2000000000;
    begin(&line, device_us, arrival_ns, size && data[0] % 2 ? 0.02 : 200e-6);
    for (size_t at = 1; at + PIECE <= size; at += PIECE) {
        const uint8_t *piece = data + at;
        unsigned us_shift = piece[0] & LEAP ? piece[1] % 33 : 3, ns_shift = piece[0] & LATE ? piece[1] % 46 : 8;
        int64_t step_us = step_of(piece + 2, us_shift), jitter_ns = step_of(piece + 4, ns_shift);
        for (int repeats = piece[0] & OFTEN ? OFTEN : 1; repeats > 0; repeats--) {
            device_us = within(device_us + step_us, MOST_US);
            arrival_ns = within(arrival_ns + (piece[0] & ALONE ? 0 : 1000 * step_us) + jitter_ns, MOST_NS);
            if (piece[0] & EMPTY)
                line.empty_ns = arrival_ns;
            take(&line, device_us, arrival_ns, piece[0] & ANEW);
        }
    }
    return 0;
}
