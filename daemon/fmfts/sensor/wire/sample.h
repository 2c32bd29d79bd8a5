/* Decodes the sample packets of docs/wire.md; only these come often. No allocation, no globals. */
#ifndef FMFTS_SAMPLE_H
#define FMFTS_SAMPLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { FMFTS_READING_BYTES = 8 /* of a sensor */, FMFTS_LONGEST_LINE = 255, FMFTS_TEMPERATURE_UNKNOWN = -32768 };

typedef struct {
    uint8_t readings[FMFTS_READING_BYTES * 8];
    uint64_t time_us;
    uint32_t sequence;
    int16_t temperature_raw;
    uint8_t pad_index, sensors, gain_code, trigger, valid, fresh;
} fmfts_sample;

/* Decodes `size` bytes of a line, without its closing zero. False: they are no sample of this wire version. */
bool fmfts_read_sample(const uint8_t *line, size_t size, fmfts_sample *sample);

/* As in hmc5983.py; NaN if the temperature is not known. */
double fmfts_temperature_c(const fmfts_sample *sample);

#endif
