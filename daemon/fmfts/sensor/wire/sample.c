/* Decodes a line that holds a sample, as framing.py and codec.py do. All other packets are left to them. */
#include "sample.h"

#include <math.h>
#include <string.h>

enum { HEADER = 0x11 /* wire version 1, type sample */, FIXED_BYTES = 17, CRC_BYTES = 2 };

static uint64_t little_endian(const uint8_t *bytes, int count)
{
    uint64_t value = 0;
    while (count-- > 0) {
        value = value << 8 | bytes[count];
    }
    return value;
}

/* CRC-16/CCITT-FALSE, a byte at a time without a table (G. Wagner's method). */
static uint16_t crc16(const uint8_t *bytes, size_t size)
{
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < size; i++) {
        uint8_t x = (uint8_t)(crc >> 8) ^ bytes[i];
        x ^= x >> 4;
        crc = (uint16_t)(crc << 8 ^ (uint16_t)(x << 12) ^ (uint16_t)(x << 5) ^ x);
    }
    return crc;
}

/* Removes COBS. Returns the packet's size, 0 if the line is no COBS. */
static size_t unstuff(const uint8_t *line, size_t size, uint8_t *packet)
{
    size_t at = 0;
    while (at < size) {
        size_t step = line[at], next = at + step;
        if (step == 0 || next > size) {
            return 0;
        }
        if (at > 0) {
            packet[at - 1] = 0;
        }
        memcpy(packet + at, line + at + 1, step - 1);
        at = next;
    }
    return size - 1;
}

bool fmfts_read_sample(const uint8_t *line, size_t size, fmfts_sample *sample)
{
    uint8_t packet[FMFTS_LONGEST_LINE];
    if (size < FIXED_BYTES + CRC_BYTES || size > FMFTS_LONGEST_LINE) {
        return false;
    }
    size_t bytes = unstuff(line, size, packet);
    if (bytes < FIXED_BYTES + CRC_BYTES || packet[0] != HEADER) {
        return false;
    }
    size_t body = bytes - CRC_BYTES, sensors = packet[1] >> 4;
    if (sensors < 1 || sensors > FMFTS_WIRE_SENSORS || body != FIXED_BYTES + FMFTS_READING_BYTES * sensors ||
        crc16(packet, body) != little_endian(packet + body, 2)) {
        return false;
    }
    sample->pad_index = packet[1] & 15;
    sample->sensors = (uint8_t)sensors;
    sample->sequence = (uint32_t)little_endian(packet + 2, 4);
    sample->time_us = little_endian(packet + 6, 6);
    sample->gain_code = packet[12] & 7;
    sample->trigger = packet[12] >> 3 & 1;
    sample->valid = packet[13];
    sample->fresh = packet[14];
    sample->temperature_raw = (int16_t)little_endian(packet + 15, 2);
    memcpy(sample->readings, packet + FIXED_BYTES, FMFTS_READING_BYTES * sensors);
    return true;
}

double fmfts_temperature_c(const fmfts_sample *sample, double at_zero_c, double c_per_count, const double *range_c)
{
    bool told = sample->temperature_raw != FMFTS_TEMPERATURE_UNKNOWN;
    double temperature_c = at_zero_c + sample->temperature_raw * c_per_count;
    return told && range_c[0] <= temperature_c && temperature_c <= range_c[1] ? temperature_c : NAN;
}
