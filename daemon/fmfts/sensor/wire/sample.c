/* Decodes a line that holds a sample or an early packet, as framing.py and codec.py do. Python decodes all others. */
#include "sample.h"

#include <math.h>
#include <string.h>

enum {
    HEADER = 0x11, /* wire version 1, type sample */
    EARLY_HEADER = 0x17,
    FIXED_BYTES = 17,
    EARLY_BODY_BYTES = 15,
    CRC_BYTES = 2,
    ONE_MASK = 8,         /* sensors whose bits fit into the masks that every sample has */
    MORE = 9,             /* in place of their number: more than these, and the packet's length says how many */
    MORE_MASKS_BYTES = 2, /* valid and fresh of the others, after the readings */
};

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

/* Undoes COBS and checks the CRC. Returns the size of header and body, 0 if the line is no packet of this header. */
static size_t checked(const uint8_t *line, size_t size, uint8_t header, uint8_t *packet)
{
    if (size < 4 || size > FMFTS_LONGEST_LINE || line[1] != header) { /* a header is never zero, so COBS leaves it */
        return 0;
    }
    size_t bytes = unstuff(line, size, packet);
    if (bytes <= CRC_BYTES || packet[0] != header) {
        return 0;
    }
    size_t body = bytes - CRC_BYTES;
    return crc16(packet, body) == little_endian(packet + body, 2) ? body : 0;
}

bool fmfts_read_sample(const uint8_t *line, size_t size, fmfts_sample *sample)
{
    uint8_t packet[FMFTS_LONGEST_LINE];
    size_t body = checked(line, size, HEADER, packet), sensors = body ? packet[1] >> 4 : 0;
    bool wide = sensors == MORE && body > FIXED_BYTES + MORE_MASKS_BYTES;
    if (wide) {
        sensors = (body - FIXED_BYTES - MORE_MASKS_BYTES) / FMFTS_READING_BYTES;
    }
    size_t masks = FIXED_BYTES + FMFTS_READING_BYTES * sensors; /* bits of sensor 9 and later ones */
    if (sensors < 1 || sensors > FMFTS_SENSORS || wide != (sensors > ONE_MASK) ||
        body != masks + (wide ? MORE_MASKS_BYTES : 0)) {
        return false;
    }
    sample->pad_index = packet[1] & 15;
    sample->sensors = (uint8_t)sensors;
    sample->sequence = (uint32_t)little_endian(packet + 2, 4);
    sample->time_us = little_endian(packet + 6, 6);
    sample->gain_code = packet[12] & 7;
    sample->trigger = packet[12] >> 3 & 1;
    sample->valid = (uint16_t)(packet[13] | (wide ? packet[masks] << ONE_MASK : 0));
    sample->fresh = (uint16_t)(packet[14] | (wide ? packet[masks + 1] << ONE_MASK : 0));
    sample->temperature_raw = (int16_t)little_endian(packet + 15, 2);
    memcpy(sample->readings, packet + FIXED_BYTES, FMFTS_READING_BYTES * sensors);
    return true;
}

bool fmfts_read_early_sample(const uint8_t *line, size_t size, fmfts_early_sample *early)
{
    uint8_t packet[FMFTS_LONGEST_LINE];
    if (checked(line, size, EARLY_HEADER, packet) != EARLY_BODY_BYTES) {
        return false;
    }
    early->pad_index = packet[1] & 15;
    early->sensor = (uint8_t)((packet[1] >> 4 & 7) | (packet[2] & 8));
    early->gain_code = packet[2] & 7;
    early->time_us = little_endian(packet + 3, 6);
    for (int axis = 0; axis < 3; axis++) {
        early->counts[axis] = (int16_t)little_endian(packet + 9 + 2 * axis, 2);
    }
    return true;
}

double fmfts_temperature_c(const fmfts_sample *sample, double at_zero_c, double c_per_count, const double *range_c)
{
    bool told = sample->temperature_raw != FMFTS_TEMPERATURE_UNKNOWN;
    double temperature_c = at_zero_c + sample->temperature_raw * c_per_count;
    return told && range_c[0] <= temperature_c && temperature_c <= range_c[1] ? temperature_c : NAN;
}
