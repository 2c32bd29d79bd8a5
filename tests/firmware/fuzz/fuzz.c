#include "fuzz.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void require(bool condition, const char *what)
{
    if (!condition) {
        fprintf(stderr, "fuzz: not so: %s\n", what);
        abort();
    }
}

// Follows the chain of zeros, where the decoder copies runs.
size_t reference_unstuff(const uint8_t *block, size_t count, uint8_t *packet)
{
    size_t length = 0, next = 0;
    bool zero = false;
    for (size_t i = 0; i < count; i++) {
        if (i != next) {
            packet[length++] = block[i];
            continue;
        }
        if (block[i] == 0)
            return 0;
        if (zero)
            packet[length++] = 0;
        zero = block[i] != 0xFF;
        next = i + block[i];
    }
    return next == count ? length : 0;
}

// Bit by bit, like the division that defines a CRC; the firmware works on bytes.
uint16_t reference_crc(const uint8_t *bytes, size_t count)
{
    uint32_t rest = 0xFFFF;
    for (size_t i = 0; i < 8 * count; i++) {
        uint32_t bit = (uint32_t)bytes[i / 8] >> (7 - i % 8) & 1U;
        rest = rest << 1 ^ ((rest >> 15 ^ bit) & 1U ? 0x1021U : 0U);
        rest &= 0xFFFF;
    }
    return (uint16_t)rest;
}

void frame_request(const uint8_t body[REQUEST_BODY], uint8_t damage, uint8_t line[REQUEST_LINE])
{
    uint8_t packet[REQUEST_BODY + 2];
    memcpy(packet, body, REQUEST_BODY);
    uint16_t crc = reference_crc(body, REQUEST_BODY);
    packet[REQUEST_BODY] = (uint8_t)crc;
    packet[REQUEST_BODY + 1] = (uint8_t)(crc >> 8);
    if (damage != DAMAGE_NONE)
        packet[damage / 8 % sizeof packet] ^= (uint8_t)(1 << damage % 8);
    size_t zero = 0;
    for (size_t i = 0; i < sizeof packet; i++) {
        line[i + 1] = packet[i];
        if (packet[i] == 0) {
            line[zero] = (uint8_t)(i + 1 - zero);
            zero = i + 1;
        }
    }
    line[zero] = (uint8_t)(sizeof packet + 1 - zero);
    line[REQUEST_LINE - 1] = 0;
}
