// The MMC5983MA (MEMSIC data sheet rev. A, pages 11 to 16: register map). The facts and what is unverified of them:
// daemon/fmfts/sensor/chips/mmc5983ma.py.
#include "memsic.h"

enum {
    STATUS = 0x08,
    CONTROL_0 = 0x09,
    PRODUCT = 0x2F,
    PRODUCT_ID = 0x30,
    STATUS_FIELD_DONE = 0x01,
    LARGEST = 32766,
    STRONG = 9 * 4096, // 9 G; above 10 G the film is upset until the next SET (page 2)
    DOUBTFUL = 5 * 4096,
    RESET_US = 10000,
};

static const struct memsic registers = {
    .status = STATUS,
    .field_done = STATUS_FIELD_DONE,
    .control_0 = CONTROL_0,
    .product = PRODUCT,
    .largest = LARGEST,
};

static bool mmc5983ma_is_identification(const uint8_t identification[3])
{
    return identification[0] == PRODUCT_ID && identification[1] == 0 && identification[2] == 0;
}

// A reading after the slowest chip's measurement: 2.2 ms, and 0.4 ms on the bus.
static const struct chip_speed speeds[] = {{380, 2630}};

static const struct chip_trigger trigger = {
    .bytes = {CONTROL_0, MEMSIC_MEASURE_FIELD},
    .count = 2,
    .conversion_us = 2000,
    .wait_us = 2200,
    .rate_max_hz = 350,
};

const struct chip chip_mmc5983ma = {
    .gain_codes = 1,
    .speed_count = sizeof speeds / sizeof *speeds,
    .paced = true,
    .strong_counts = STRONG,
    .doubtful_counts = DOUBTFUL,
    .reset_us = RESET_US,
    .speeds = speeds,
    .trigger = &trigger,
    .memsic = &registers,
    .identify = memsic_identify,
    .is_identification = mmc5983ma_is_identification,
    .reset = memsic_reset,
    .set_up = memsic_set_up,
    .check = memsic_check,
    .set = memsic_set,
    .read_status = memsic_read_status,
    .read_counts = memsic_read_counts,
};
