// A LIS3MDL, register by register.
// emulated_lis3mdl.c names the sources.
#ifndef FMFTS_EMULATED_LIS3MDL_H
#define FMFTS_EMULATED_LIS3MDL_H

#include "magnetometer.h"

struct emulated_lis3mdl {
    struct emulated_magnetometer common;
    uint8_t unread; // bit i: output byte i was not read since the last conversion
};

void emulated_lis3mdl_init(struct emulated_lis3mdl *chip, uint8_t address, uint32_t seed);

#endif
