// A QMC5883P as public drivers describe it: ArduPilot AP_Compass_QMC5883P, Adafruit_QMC5883P, lionyhw/MQC5883P_nrf52 and
// reznikmm/qmc5883p, which quotes the data sheet (DRDY and OVFL are cleared by reading the status, OVFL is set beyond ±30000
// counts, the outputs saturate at -32768 and 32767).
//
// Unverified: what clears DRDY (a test may choose), which axes are turned before 0x29 = 0x06 was written, how long a single
// measurement takes, how fast mode "continuous" is, the noise at other ranges than ±2 G, the effect of warmth.
#ifndef FMFTS_EMULATED_QMC5883P_H
#define FMFTS_EMULATED_QMC5883P_H

#include "magnetometer.h"

struct emulated_qmc5883p {
    struct emulated_magnetometer common;
    bool cleared_by_data; // DRDY is cleared by reading an output, and not by reading the status
    bool signs_defined;   // 0x29 = 0x06 was written since the reset
};

void emulated_qmc5883p_init(struct emulated_qmc5883p *chip, uint32_t seed);

#endif
