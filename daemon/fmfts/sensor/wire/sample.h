/* Decodes the sample and early packets of firmware/wire.md; only these come often. No allocation, no globals. */
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
    uint8_t readings[FMFTS_READING_BYTES * FMFTS_SENSORS];
    uint64_t time_us;
    uint32_t sequence;
    int16_t temperature_raw;
    uint16_t valid, fresh;
    uint8_t pad_index, sensors, gain_code, trigger;
} fmfts_sample;

/* Decodes `size` bytes of a line, without its closing zero. False: they are no sample of this wire version. */
bool fmfts_read_sample(const uint8_t *line, size_t size, fmfts_sample *sample);

/* One sensor's sample, which came before its frame. */
typedef struct {
    uint64_t time_us;
    int16_t counts[3];
    uint8_t pad_index, sensor, gain_code;
} fmfts_early_sample;

/* The same of an early packet. */
bool fmfts_read_early_sample(const uint8_t *line, size_t size, fmfts_early_sample *early);

/* As Chip.temperature_c; NaN if the temperature is unknown or impossible, or if all numbers are NaN (a chip without a
 * thermometer). range_c: lowest and highest. */
double fmfts_temperature_c(const fmfts_sample *sample, double at_zero_c, double c_per_count, const double *range_c);

#endif
