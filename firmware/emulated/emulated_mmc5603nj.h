// An MMC5603NJ as public drivers describe it: the Linux driver mmc5633, Zephyr drivers/sensor/memsic/mmc56x3,
// Adafruit_MMC56x3, mgershow/MMC5603NJ, PebbleOS. emulated_memsic.h has the film.
//
// Unverified: its handedness, the field that upsets its film, its noise at bandwidths other than 00, when it sets
// Sat_sensor, and that an automatic set/reset takes just twice the time (its fastest rates fit that).
#ifndef FMFTS_EMULATED_MMC5603NJ_H
#define FMFTS_EMULATED_MMC5603NJ_H

#include "emulated_memsic.h"

struct emulated_mmc5603nj {
    union {
        struct emulated_magnetometer common;
        struct emulated_memsic memsic;
    };
    uint8_t rate_hz;       // as written
    uint64_t period_ns;    // as Cmm_freq_en took it
};

void emulated_mmc5603nj_init(struct emulated_mmc5603nj *chip, uint32_t seed);

#endif
