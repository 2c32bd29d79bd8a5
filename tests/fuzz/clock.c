// The map from a board's clock to the host's, over packets of any times that the board can count and the host can have.
// After a first byte for the tolerance, pieces of six: flags, a shift for the flagged items, the advance of the board's
// clock, and the extra advance of the arrival.
#include <math.h>
#include <string.h>

#include "../../daemon/fmfts/sensor/wire/clock.h"
#include "../firmware/fuzz/fuzz.h"

enum { PIECE = 6 };

// Flags: the board's clock leaps; the packet is late; this many packets are alike; the arrival does not follow the
// board's clock; the host found no byte unread; the line to the board was opened anew.
enum { LEAP = 1, LATE = 2, ALONE = 4, EMPTY = 8, ANEW = 16, OFTEN = 32 };

static const int64_t MOST_US = (INT64_C(1) << 48) - 1, MOST_NS = (INT64_C(1) << 62) - 1;

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
    if (anew)
        fmfts_restart_clock(line);
    bool is_first = !line->begun, goes_on = fmfts_goes_on(line, device_us, arrival_ns);
    int64_t origin_us = line->origin.us, host_ns = fmfts_host_time(line, device_us, arrival_ns);
    require(host_ns <= arrival_ns, "no sample was taken after it arrived");
    require(line->begun, "a clock learns from every packet");
    require(!is_first || goes_on, "the first packet goes on");
    require(goes_on || (line->origin.us == device_us && line->minima == 0), "a packet that does not go on is the first one");
    require(is_first || line->origin.us == device_us || line->origin.us == origin_us, "only a packet begins the clock anew");
    require(line->minima >= 0 && line->minima <= FMFTS_SLOPE_BUCKETS, "minima have places");
    require(isfinite(line->height_ns) && fabs(line->slope_ns_per_us) <= line->tolerance_ns_per_us, "the line is one");
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fmfts_clock_line line;
    int64_t device_us = 1000000, arrival_ns = 2000000000;
    memset(&line, 0, sizeof line);
    line.tolerance_ns_per_us = 1000.0 * (size && data[0] % 2 ? 0.02 : 200e-6); // DeviceClock gives it
    fmfts_restart_clock(&line);
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
