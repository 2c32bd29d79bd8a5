// An MMC5983MA as MEMSIC's data sheet (rev. A) describes it.
#ifndef FMFTS_EMULATED_MMC5983MA_H
#define FMFTS_EMULATED_MMC5983MA_H

#include "magnetometer.h"

struct emulated_mmc5983ma {
    struct emulated_magnetometer common;
    uint8_t controls[4];      // internal control 0 to 3: they can be written only
    bool magnetised;          // a field of more than 10 G was there since the last SET
    uint64_t starts_until_ns; // after a reset
    // The data sheet does not say whether a transfer sees one measurement, or the outputs change while they are read. A
    // test may set it.
    bool holds_outputs;
    uint8_t held[8]; // what that transfer sees
};

void emulated_mmc5983ma_init(struct emulated_mmc5983ma *chip, uint32_t seed);

#endif
