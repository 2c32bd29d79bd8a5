// A wrong driver of the MMC5983MA, which the tests must catch. This firmware had it until it was found that a
// measurement with automatic set/reset takes more than twice its time (DRNadler/MMC5983MA_CompassTest; data sheet rev.
// A, page 2).
#include "chip.h"

enum {
    AXES = 0x00, // Xout0 to Zout1: the upper 16 of 18 bits, high byte first; zero field is in the middle
    STATUS = 0x08,
    CONTROL_0 = 0x09, // the controls cannot be read back; a bit that starts something clears itself
    CONTROL_1 = 0x0A, // the bandwidth in bits 1–0
    PRODUCT = 0x2F,
    PRODUCT_ID = 0x30,
    STATUS_FIELD_DONE = 0x01,
    STATUS_FUSES_READ = 0x10,
    MEASURE_FIELD = 0x01,
    AUTOMATIC_SET = 0x20, // a set pulse before a measurement removes the effect of a strong magnet
    RESET = 0x80,
    CONTINUOUS = 0x08,
    PERIODIC_SET = 0x80, // control 2, bits 6–4 are 0: even in a stream the pulse precedes every measurement
    ZERO = 0x8000,
    LARGEST = 32766,
    RESET_US = 10000,
    SINGLE_BANDWIDTH = 2, // a measurement takes 2 ms
};

// Below 100 Hz nothing is gained: the noise depends on the bandwidth. A bandwidth's measurement must be over in its
// period: 8 ms, 4 ms, 0.5 ms.
static const struct chip_speed speeds[] = {{100, 10000}, {200, 5000}, {1000, 1000}};
static const uint8_t rate_codes[] = {5, 6, 7}, bandwidths[] = {0, 1, 3};

static enum bus_result mmc5983ma_identify(const struct chip_wires *wires, uint8_t identification[3])
{
    identification[1] = identification[2] = 0;
    return chip_read(wires, PRODUCT, identification, 1);
}

static bool mmc5983ma_is_identification(const uint8_t identification[3])
{
    return identification[0] == PRODUCT_ID && identification[1] == 0 && identification[2] == 0;
}

static enum bus_result mmc5983ma_reset(const struct chip_wires *wires)
{
    const uint8_t bytes[] = {CONTROL_1, RESET};
    return chip_write(wires, bytes, sizeof bytes);
}

static enum bus_result mmc5983ma_set_up(const struct chip_wires *wires, const struct chip_setup *setup)
{
    const uint8_t stream = (uint8_t)(PERIODIC_SET | CONTINUOUS | rate_codes[setup->speed]);
    const uint8_t controls[] = {
        CONTROL_0,
        AUTOMATIC_SET,
        setup->streams ? bandwidths[setup->speed] : SINGLE_BANDWIDTH,
        setup->streams ? stream : 0,
    };
    return chip_write(wires, controls, sizeof controls);
}

// As far as it reports: its factory settings are loaded. After a reset it delivers nothing, which is noticed.
static enum bus_result mmc5983ma_check(const struct chip_wires *wires, const struct chip_setup *setup, bool *held)
{
    uint8_t status = 0;
    enum bus_result result = chip_read(wires, STATUS, &status, 1);
    (void)setup;
    *held = status & STATUS_FUSES_READ;
    return result;
}

static enum bus_result mmc5983ma_read_status(const struct chip_wires *wires, struct chip_sample *sample)
{
    uint8_t status = 0;
    enum bus_result result = chip_read(wires, STATUS, &status, 1);
    sample->status = status & STATUS_FIELD_DONE ? CHIP_READY : 0;
    return result;
}

// "Done" stays until it is cleared. It is cleared before the axes are read, so that no measurement is lost. If it is
// set again afterwards, these bytes may belong to the new measurement, the previous one, or both.
static enum bus_result mmc5983ma_read_counts(const struct chip_wires *wires, int16_t counts[3])
{
    const uint8_t clear[] = {STATUS, STATUS_FIELD_DONE};
    uint8_t data[6];
    enum bus_result result = chip_write(wires, clear, sizeof clear);
    if (result == BUS_OK)
        result = chip_read(wires, AXES, data, sizeof data);
    for (int axis = 0; axis < 3 && result == BUS_OK; axis++)
        counts[axis] = chip_limited((data[2 * axis] << 8 | data[2 * axis + 1]) - ZERO, LARGEST);
    return result;
}

static const struct chip_trigger trigger = {
    .bytes = {CONTROL_0, AUTOMATIC_SET | MEASURE_FIELD},
    .count = 2,
    .conversion_us = 2000,
    .wait_us = 2200,
    .rate_max_hz = 350,
};

const struct chip chip_mmc5983ma = {
    .gain_codes = 1,
    .speed_count = sizeof speeds / sizeof *speeds,
    .reset_us = RESET_US,
    .speeds = speeds,
    .trigger = &trigger,
    .identify = mmc5983ma_identify,
    .is_identification = mmc5983ma_is_identification,
    .reset = mmc5983ma_reset,
    .set_up = mmc5983ma_set_up,
    .check = mmc5983ma_check,
    .read_status = mmc5983ma_read_status,
    .read_counts = mmc5983ma_read_counts,
};
