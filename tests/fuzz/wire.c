// The daemon's compiled reader of the wire, for any bytes of a port: it reads exactly the packets that firmware/wire.md
// allows, and drops superseded samples without changing any other byte. The first two bytes are the patience. An input
// whose third byte is odd is a series of pieces: the size of a body, the body and its damage, framed as lines. Any
// other input is used as bytes.
#include <stdlib.h>

#include "../../daemon/fmfts/sensor/wire/newest.h"
#include "framed.h"

enum { HEAD = 3, BLOCK_MAX = 4096, SAMPLE = 0x11, EARLY = 0x17, CRC = 2, SENSORS = 16 };

static uint8_t *copied(const uint8_t *bytes, size_t size)
{
    uint8_t *copy = malloc(size ? size : 1);
    require(copy != NULL, "there is memory");
    if (size)
        memcpy(copy, bytes, size);
    return copy;
}

// Sensors that a sample with a body of this size may have by firmware/wire.md; 0: no sample has this size.
static size_t sensors_of(const uint8_t *body, size_t size)
{
    size_t few = body[1] >> 4, more = (size - 19) / 8;
    if (few >= 1 && few <= 8)
        return size == 17 + 8 * few ? few : 0;
    return few == 9 && size > 19 && size == 19 + 8 * more && more > 8 && more <= SENSORS ? more : 0;
}

// Reads one line, from memory of exactly its size. Returns whether it is a sample (2) or an early one (1) of a pad that is.
static int check_line(const uint8_t *bytes, size_t size)
{
    uint8_t packet[FMFTS_LONGEST_LINE], *line = copied(bytes, size);
    size_t whole = size <= sizeof packet ? reference_unstuff(bytes, size, packet) : 0, body = whole > CRC ? whole - CRC : 0;
    bool good = body > 1 && reference_crc(packet, body) == (packet[body] | packet[body + 1] << 8);
    size_t sensors = good && packet[0] == SAMPLE && body >= 17 ? sensors_of(packet, body) : 0;
    fmfts_sample sample;
    fmfts_early_sample early;
    bool is_sample = fmfts_read_sample(line, size, &sample), is_early = fmfts_read_early_sample(line, size, &early);
    free(line);
    require(is_sample == (sensors > 0), "a sample is read if, and only if, it is whole");
    require(is_early == (good && packet[0] == EARLY && body == 15), "an early sample is read if, and only if, it is whole");
    if (is_sample) {
        const double range_c[] = {-40.0, 125.0};
        double celsius = fmfts_temperature_c(&sample, 25.0, 0.01, range_c);
        require(!(celsius < range_c[0]) && !(celsius > range_c[1]), "a temperature is possible, or none");
        bool same = sample.sensors == sensors && memcmp(sample.readings, packet + 17, 8 * sensors) == 0;
        require(same, "the readings are those that were sent");
        require(sample.time_us >> 48 == 0 && sample.gain_code < 8 && sample.trigger < 2, "each number is of its range");
        return sample.pad_index < FMFTS_WIRE_PADS ? 2 : 0;
    }
    if (is_early) {
        require(early.sensor < SENSORS && early.gain_code < 8 && early.time_us >> 48 == 0, "each number is of its range");
        return early.pad_index < FMFTS_WIRE_PADS ? 1 : 0;
    }
    return 0;
}

// Every kept line was there, in the same order; every dropped line was a sample.
static void check_newest(const uint8_t *all, size_t size, const uint8_t *kept, size_t left, const unsigned *left_out)
{
    unsigned samples = 0;
    size_t at = 0, lines = 0;
    for (size_t begin = 0; begin < size; lines++) {
        const uint8_t *zero = memchr(all + begin, 0, size - begin);
        size_t end = zero ? (size_t)(zero - all) + 1 : size;
        int kind = zero ? check_line(all + begin, end - 1 - begin) : 0;
        bool stays = left - at >= end - begin && memcmp(all + begin, kept + at, end - begin) == 0;
        // A line may occur twice: of equal lines, any may have been dropped.
        if (stays)
            at += end - begin;
        else
            require(kind > 0, "only samples are left out");
        samples += kind == 2;
        begin = end;
    }
    require(at == left, "nothing stays that was not there, and nothing changes its place");
    require(left_out[0] + left_out[1] + left_out[2] <= samples, "no more samples are left out than there are");
    require(lines > 1 || left == size, "a single line stays");
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    uint8_t block[BLOCK_MAX + LINE_MAX_BYTES];
    size_t filled = 0;
    if (size < HEAD || size > BLOCK_MAX)
        return 0;
    if (data[2] % 2 == 0) {
        filled = size - HEAD;
        memcpy(block, data + HEAD, filled);
    } else {
        for (size_t at = HEAD; at < size && filled < BLOCK_MAX;) {
            size_t body = data[at] < 200 ? data[at] : data[at] + 100U, rest = size - at - 1;
            if (body + 1 > rest)
                break;
            filled += framed(data + at + 1, body, data[at + 1 + body], block + filled);
            at += body + 2;
        }
    }
    fmfts_patience patience = {data[0] % 4 == 3 ? 1U << 30 : data[0] % 4, data[1] * INT64_C(1000)};
    unsigned left_out[FMFTS_WIRE_PADS] = {0};
    uint8_t *kept = copied(block, filled);
    size_t left = fmfts_keep_newest(kept, filled, patience, left_out);
    require(left <= filled, "nothing is added");
    check_newest(block, filled, kept, left, left_out);
    free(kept);
    return 0;
}
