// A QMC5883P, register by register.
// emulated_qmc5883p.c names the sources.
#ifndef FMFTS_EMULATED_QMC5883P_H
#define FMFTS_EMULATED_QMC5883P_H

#include "magnetometer.h"

struct emulated_qmc5883p {
    struct emulated_magnetometer common;
    bool cleared_by_data; // reading an output clears DRDY, and reading the status does not
    bool signs_defined;   // 0x29 = 0x06 was written since the reset
};

void emulated_qmc5883p_init(struct emulated_qmc5883p *chip, uint32_t seed);

#endif
