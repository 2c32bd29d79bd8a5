#include "ring.h"

void ring_init(struct ring *ring, uint8_t *bytes, uint16_t size)
{
    *ring = (struct ring){.bytes = bytes, .size = size};
}

static unsigned waiting(const struct ring *ring)
{
    unsigned span = 2U * ring->size;
    return (ring->written + span - ring->taken) % span;
}

bool ring_put(struct ring *ring, const uint8_t *bytes, size_t count)
{
    if (count > ring->size - waiting(ring))
        return false;
    unsigned at = ring->written;
    for (size_t i = 0; i < count; i++)
        ring->bytes[(at + i) % ring->size] = bytes[i];
    ring->written = (uint16_t)((at + count) % (2U * ring->size));
    return true;
}

const uint8_t *ring_peek(const struct ring *ring, size_t *count)
{
    unsigned at = ring->taken % ring->size, until_end = ring->size - at, ready = waiting(ring);
    *count = ready < until_end ? ready : until_end;
    return ring->bytes + at;
}

void ring_drop(struct ring *ring, size_t count)
{
    ring->taken = (uint16_t)((ring->taken + count) % (2U * ring->size));
}
