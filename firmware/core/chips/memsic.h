// What the MMC5983MA and the MMC5603NJ share: the same bits, in registers with other numbers.
#ifndef FMFTS_MEMSIC_H
#define FMFTS_MEMSIC_H

#include "chip.h"

enum {
    // Control 0. A bit that starts something clears itself.
    MEMSIC_MEASURE_FIELD = 0x01,
    MEMSIC_SET = 0x08,
};

struct memsic {
    uint8_t status;
    uint8_t field_done; // bit of the status: cleared by the next trigger
    uint8_t control_0;  // control 1 follows it; neither can be read back
    uint8_t product;    // the identification's register
    int16_t largest;    // count
};

enum bus_result memsic_identify(const struct chip_wires *wires, uint8_t identification[3]);
enum bus_result memsic_reset(const struct chip_wires *wires);
enum bus_result memsic_set_up(const struct chip_wires *wires, const struct chip_setup *setup);
enum bus_result memsic_check(const struct chip_wires *wires, const struct chip_setup *setup, bool *held);
enum bus_result memsic_set(const struct chip_wires *wires);
enum bus_result memsic_read_status(const struct chip_wires *wires, struct chip_sample *sample);
enum bus_result memsic_read_counts(const struct chip_wires *wires, int16_t counts[3]);

#endif
