// Random bytes almost never have the right CRC: this frames bytes as firmware/wire.md says. damage: none; below OVERLONG, the bit
// that is flipped; from there on, by how much the last run of COBS reaches beyond the line.
#ifndef FMFTS_FRAMED_H
#define FMFTS_FRAMED_H

#include <string.h>

#include "../firmware/fuzz/fuzz.h"

enum { BODY_MAX = 360, OVERLONG = 128, LINE_MAX_BYTES = BODY_MAX + 4 };

// Returns the line's size, with its closing zero. line: LINE_MAX_BYTES. size: at most BODY_MAX.
static inline size_t framed(const uint8_t *body, size_t size, uint8_t damage, uint8_t *line)
{
    uint8_t packet[BODY_MAX + 2];
    memcpy(packet, body, size);
    uint16_t crc = reference_crc(body, size);
    packet[size++] = (uint8_t)crc;
    packet[size++] = (uint8_t)(crc >> 8);
    if (damage != DAMAGE_NONE && damage < OVERLONG)
        packet[damage / 8 % size] ^= (uint8_t)(1 << damage % 8);
    size_t zero = 0;
    for (size_t i = 0; i < size; i++) {
        line[i + 1] = packet[i];
        if (packet[i] == 0) {
            line[zero] = (uint8_t)(i + 1 - zero);
            zero = i + 1;
        }
    }
    line[zero] = (uint8_t)(size + 1 - zero + (damage < OVERLONG ? 0U : damage - OVERLONG + 1U));
    line[size + 1] = 0;
    return size + 2;
}

#endif
