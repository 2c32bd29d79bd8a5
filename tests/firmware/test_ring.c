#include <string.h>

#include "../../firmware/core/ring.h"
#include "harness.h"

TEST(ring_takes_whole_lines_or_nothing)
{
    struct ring ring;
    uint8_t bytes[8];
    size_t count;
    ring_init(&ring, bytes, sizeof bytes);
    CHECK(ring_put(&ring, (const uint8_t *)"abcde", 5));
    CHECK(!ring_put(&ring, (const uint8_t *)"fghi", 4));
    CHECK(ring_put(&ring, (const uint8_t *)"fgh", 3));
    CHECK(!ring_put(&ring, (const uint8_t *)"i", 1));
    CHECK(memcmp(ring_peek(&ring, &count), "abcdefgh", 8) == 0);
    CHECK_EQUAL(count, 8);
}

TEST(ring_keeps_order_around_its_end_for_long)
{
    struct ring ring;
    uint8_t bytes[7], next_in = 0, next_out = 0;
    ring_init(&ring, bytes, sizeof bytes);
    for (int trial = 0; trial < 5000; trial++) {
        uint8_t line[4] = {next_in, (uint8_t)(next_in + 1), (uint8_t)(next_in + 2), (uint8_t)(next_in + 3)};
        size_t count, length = (size_t)(trial % 4) + 1;
        if (ring_put(&ring, line, length))
            next_in = (uint8_t)(next_in + length);
        const uint8_t *out = ring_peek(&ring, &count);
        size_t taken = trial % 3 ? count : count / 2;
        for (size_t i = 0; i < taken; i++)
            CHECK_EQUAL(out[i], next_out++);
        ring_drop(&ring, taken);
    }
}
