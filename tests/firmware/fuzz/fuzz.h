// What the fuzz targets share: a second, independent reading of firmware/wire.md, and how an input becomes bytes on the line.
#ifndef FMFTS_FUZZ_H
#define FMFTS_FUZZ_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { REQUEST_BODY = 5, REQUEST_LINE = 9, DAMAGE_NONE = 0 };

// Ends the program, as a crash does.
void require(bool condition, const char *what);

// One COBS block without its zero. Returns the packet's length, 0 when the block is no COBS.
size_t reference_unstuff(const uint8_t *block, size_t count, uint8_t *packet);
uint16_t reference_crc(const uint8_t *bytes, size_t count);

// Random bytes almost never have the right CRC. This frames five bytes as a request, with the bit flipped that `damage`
// names, or none.
void frame_request(const uint8_t body[REQUEST_BODY], uint8_t damage, uint8_t line[REQUEST_LINE]);

// The fuzz target itself; libFuzzer's name.
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#endif
