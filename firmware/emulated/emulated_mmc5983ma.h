// An MMC5983MA, register by register; emulated_memsic.c has the film.
// emulated_mmc5983ma.c names the sources.
#ifndef FMFTS_EMULATED_MMC5983MA_H
#define FMFTS_EMULATED_MMC5983MA_H

#include "emulated_memsic.h"

struct emulated_mmc5983ma {
    union {
        struct emulated_magnetometer common;
        struct emulated_memsic memsic;
    };
    // SparkFun's library, issues 9, 10 and 12: with a command of exactly 0x21, x of every 16th sample is off by 10 to 12 uT.
    unsigned asked_exactly;
    // The data sheet does not say whether a transfer sees one measurement, or whether outputs change during the read. A
    // test may set it.
    bool holds_outputs;
    uint8_t held[8]; // the values that this transfer sees
};

void emulated_mmc5983ma_init(struct emulated_mmc5983ma *chip, uint32_t seed);

#endif
