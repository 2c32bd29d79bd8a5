/* Writes the numbers of a frame into a message template: template.py. */
#include <string.h>

#include "tables.h"

/* Writes 8 bytes, big-endian. The msgpack type byte before them is already in the template. */
static void put_unsigned(uint8_t *place, uint64_t value)
{
    for (int byte = 8; byte-- > 0; value >>= 8) {
        place[byte] = (uint8_t)value;
    }
}

static void put_float(uint8_t *place, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_unsigned(place, bits);
}

void fmfts_write_numbers(uint8_t *text, size_t size, const int32_t *place, const unsigned long long *integer,
                const fmfts_numbers *numbers)
{
    const double *number = (const double *)numbers;
    for (size_t i = 0; i < FMFTS_MESSAGE_INTEGERS + FMFTS_NUMBER_COUNT; i++) {
        if (place[i] < 0 || (size_t)place[i] + 8 > size) {
            continue;
        }
        if (i < FMFTS_MESSAGE_INTEGERS) {
            put_unsigned(text + place[i], integer[i]);
        } else {
            put_float(text + place[i], number[i - FMFTS_MESSAGE_INTEGERS]);
        }
    }
}
