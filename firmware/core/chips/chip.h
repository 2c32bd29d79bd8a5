// A kind of magnetometer as the sampler sees it: one file of this folder for each, and hmc5983.c.
#ifndef FMFTS_CHIP_H
#define FMFTS_CHIP_H

#include <stdbool.h>
#include <stdint.h>

#include "../bus.h"

struct chip_setup {
    uint8_t gain_code;
    bool streams; // by its own clock; else it waits for a trigger
};

struct chip {
    uint8_t address;
    uint8_t gain_codes;
    bool has_trigger;    // HMC5983_MODE, and a self-test with its bias strap
    uint16_t rate_hz;    // of its stream
    uint16_t period_us;  // at that rate
    enum bus_result (*identify)(const struct bus *bus, uint8_t identification[3]);
    bool (*is_identification)(const uint8_t identification[3]);
    enum bus_result (*set_up)(const struct bus *bus, const struct chip_setup *setup);
    enum bus_result (*check)(const struct bus *bus, const struct chip_setup *setup, bool *held);
    // HMC5983_READY, and HMC5983_LOCKED where the outputs are frozen until they are read.
    enum bus_result (*read_status)(const struct bus *bus, uint8_t *status);
    // x, y, z in the counts of docs/wire.md; saturated axes marked as the daemon's description of the chip says.
    enum bus_result (*read_counts)(const struct bus *bus, int16_t counts[3]);
    enum bus_result (*read_thermometer)(const struct bus *bus, int16_t *raw); // NULL: it has none
};

enum { CHIP_KINDS = 2 };

// The first is tried first.
extern const struct chip *const chip_kinds[CHIP_KINDS];
extern const struct chip chip_hmc5983, chip_qmc5883l;

#endif
