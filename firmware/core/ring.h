// A transmit ring that takes whole lines or nothing. One writer, one reader (an interrupt, a DMA channel).
#ifndef FMFTS_RING_H
#define FMFTS_RING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct ring {
    uint8_t *bytes;
    uint16_t size;
    volatile uint16_t written; // `written` and `taken` count modulo 2·size, so that full and empty differ
    volatile uint16_t taken;
};

void ring_init(struct ring *ring, uint8_t *bytes, uint16_t size);
bool ring_put(struct ring *ring, const uint8_t *bytes, size_t count);

// The longest contiguous run of waiting bytes. Call ring_drop for the bytes that were sent.
const uint8_t *ring_peek(const struct ring *ring, size_t *count);
void ring_drop(struct ring *ring, size_t count);

#endif
