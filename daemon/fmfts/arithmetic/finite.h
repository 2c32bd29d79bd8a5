/* Whether all floating-point numbers of a msgpack message are finite. */
#ifndef FMFTS_FINITE_H
#define FMFTS_FINITE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The `count` bytes from `at` on as a big-endian number. */
static inline uint64_t fmfts_big_endian(const uint8_t *at, size_t count)
{
    uint64_t number = 0;
    for (size_t i = 0; i < count; i++) {
        number = number << 8 | at[i];
    }
    return number;
}

/* Bytes of one msgpack item after its type, without the items that it contains: those follow. count: bytes that are left after
 * the type. SIZE_MAX: an unknown type, or one that is cut off. */
static inline size_t fmfts_item_bytes(uint8_t type, const uint8_t *at, size_t count)
{
    /* From 0xc0 on: the bytes of the item, or 16 plus the bytes that hold the length of the content. 99: unknown. */
    static const uint8_t after[32] = {0, 99, 0, 0, 17, 18, 20, 99, 99, 99, 4, 8, 1, 2, 4,  8,
                                      1, 2,  4, 8, 99, 99, 99, 99, 99, 17, 18, 20, 2, 4, 2, 4};
    size_t bytes = type >= 0xa0 && type < 0xc0 ? type & 31u : type >= 0xc0 && type < 0xe0 ? after[type - 0xc0] : 0;
    if (bytes == 99) {
        return SIZE_MAX;
    }
    if (type >= 0xc0 && bytes > 16) {
        size_t length = bytes - 16;
        /* size_t may have 32 bits. */
        uint64_t whole = count < length ? SIZE_MAX : length + fmfts_big_endian(at, length);
        bytes = whole > count ? SIZE_MAX : (size_t)whole;
    }
    return bytes > count ? SIZE_MAX : bytes;
}

/* False, too, where `message` holds what no message of fmfts does. */
static inline bool fmfts_has_finite_numbers(const uint8_t *message, size_t count)
{
    for (size_t at = 0; at < count;) {
        uint8_t type = message[at++];
        size_t bytes = fmfts_item_bytes(type, message + at, count - at);
        if (bytes == SIZE_MAX) {
            return false;
        }
        /* All bits of the exponent are set. */
        uint64_t exponent = type == 0xcb ? 0x7ff0000000000000u : type == 0xca ? 0x7f800000u : 0;
        if (exponent && (fmfts_big_endian(message + at, bytes) & exponent) == exponent) {
            return false;
        }
        at += bytes;
    }
    return true;
}

#endif
