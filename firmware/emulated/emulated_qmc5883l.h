// A QMC5883L, register by register.
// emulated_qmc5883l.c names the sources.
#ifndef FMFTS_EMULATED_QMC5883L_H
#define FMFTS_EMULATED_QMC5883L_H

#include "magnetometer.h"

struct emulated_qmc5883l {
    struct emulated_magnetometer common;
    // A field beyond this sets OVL although no axis is at its last count; 0: only the last count sets OVL. The data
    // sheet does not say where between its range and the last count OVL begins. A test may set it.
    double overflow_gauss;
    bool woken; // register 0x00 was read since power-on; before that the identity reads as zero
};

void emulated_qmc5883l_init(struct emulated_qmc5883l *chip, uint32_t seed);

#endif
