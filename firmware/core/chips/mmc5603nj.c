// The MMC5603NJ (registers and times as Linux' driver mmc5633, Zephyr's mmc56x3 and Adafruit_MMC56x3 have them). The facts and
// what is unverified of them: daemon/fmfts/sensor/chips/mmc5603nj.py.
#include "memsic.h"

enum {
    STATUS = 0x18,
    CONTROL_0 = 0x1B,
    PRODUCT = 0x39,
    PRODUCT_ID = 0x10,
    STATUS_FIELD_DONE = 0x40,
    LARGEST = 30720, // 30 G
    STRONG = 30 * 1024, // 30 G; unverified: assumed to be the field that its film withstands
    DOUBTFUL = 15 * 1024,
    RESET_US = 20000,
};

static const struct memsic registers = {
    .status = STATUS,
    .field_done = STATUS_FIELD_DONE,
    .control_0 = CONTROL_0,
    .product = PRODUCT,
    .largest = LARGEST,
};

static bool mmc5603nj_is_identification(const uint8_t identification[3])
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

const struct chip chip_mmc5603nj = {
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
    .is_identification = mmc5603nj_is_identification,
    .reset = memsic_reset,
    .set_up = memsic_set_up,
    .check = memsic_check,
    .set = memsic_set,
    .read_status = memsic_read_status,
    .read_counts = memsic_read_counts,
};
