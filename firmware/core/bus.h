// What every target gives to the core: I2C transfers and a microsecond counter.
#ifndef FMFTS_BUS_H
#define FMFTS_BUS_H

#include <stddef.h>
#include <stdint.h>

enum bus_result {
    BUS_OK,
    BUS_NO_ANSWER,   // address or data not acknowledged
    BUS_TIMEOUT,     // the peripheral did not finish in time
    BUS_ARBITRATION, // another master, or noise
    BUS_STUCK,       // SDA or SCL held low
};

// Each function is one transfer from START to STOP. None waits longer than a few milliseconds.
struct bus {
    enum bus_result (*write)(void *context, uint8_t address, const uint8_t *bytes, size_t count);
    enum bus_result (*read)(void *context, uint8_t address, uint8_t *bytes, size_t count);
    // Writes the register number, then reads after a repeated START.
    enum bus_result (*read_register)(void *context, uint8_t address, uint8_t number, uint8_t *bytes, size_t count);
    // Frees stuck lines with clock pulses, STOP, and the mux's RESET pin where it is wired. BUS_STUCK: still stuck.
    enum bus_result (*recover)(void *context);
    void *context;
};

// A free-running 32-bit microsecond counter, extended to 64 bits. Call clock_now at least once in 71 minutes.
struct clock {
    uint32_t (*now_us)(void *context);
    void *context;
    uint64_t extended_us;
};

static inline uint64_t clock_now(struct clock *clock)
{
    uint32_t elapsed = clock->now_us(clock->context) - (uint32_t)clock->extended_us;
    clock->extended_us += elapsed;
    return clock->extended_us;
}

#endif
