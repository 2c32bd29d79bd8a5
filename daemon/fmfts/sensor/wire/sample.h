/* Sample packets of docs/wire.md, the only ones that come often. No allocation, no globals. */
#ifndef FMFTS_SAMPLE_H
#define FMFTS_SAMPLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "../reading.h"

enum {
    FMFTS_WIRE_PADS = 3, /* of a board, at most */
    FMFTS_LONGEST_LINE = 255,
    FMFTS_TEMPERATURE_UNKNOWN = -32768
};

typedef struct {
    uint8_t readings[FMFTS_READING_BYTES * FMFTS_WIRE_SENSORS];
    uint64_t time_us;
    uint32_t sequence;
    int16_t temperature_raw;
    uint8_t pad_index, sensors, gain_code, trigger, valid, fresh;
} fmfts_sample;

/* Whether the bytes [0, size) of a line, its closing zero left out, are a sample of this wire version. */
bool fmfts_read_sample(const uint8_t *line, size_t size, fmfts_sample *sample);

/* The chip's thermometer: Chip.temperature_c. NaN where none told, and where a chip without one has both numbers NaN. */
double fmfts_temperature_c(const fmfts_sample *sample, double at_zero_c, double c_per_count);

#endif
