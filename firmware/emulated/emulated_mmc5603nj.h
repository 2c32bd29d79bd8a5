// An MMC5603NJ, register by register; emulated_memsic.c has the film.
// emulated_mmc5603nj.c names the sources.
#ifndef FMFTS_EMULATED_MMC5603NJ_H
#define FMFTS_EMULATED_MMC5603NJ_H

#include "emulated_memsic.h"

struct emulated_mmc5603nj {
    union {
        struct emulated_magnetometer common;
        struct emulated_memsic memsic;
    };
    uint8_t rate_hz;       // as written
    uint64_t period_ns;    // as latched by Cmm_freq_en
};

void emulated_mmc5603nj_init(struct emulated_mmc5603nj *chip, uint32_t seed);

#endif
