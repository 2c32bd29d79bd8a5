// The QMC5883P (registers as ArduPilot's AP_Compass_QMC5883P, Adafruit_QMC5883P and SlimeVR's tracker have them): what
// boards sold as HMC5883L and QMC5883L carry now. The facts and what is unverified of them:
// daemon/fmfts/sensor/chips/qmc5883p.py.
#include "chip.h"

enum {
    PRODUCT = 0x00,
    PRODUCT_ID = 0x80,
    ADDRESS = 0x2C, // also expected in the identification, because the chip has only one identifying byte
    DATA = 0x01,    // x, y, z; low byte first
    STATUS = 0x09,
    CONTROL_1 = 0x0A,
    CONTROL_2 = 0x0B,
    SIGNS = 0x29, // must be written first, and cannot be read back (data sheet, examples 7.1 and 7.2)
    SIGNS_OF_AXES = 0x06,
    STATUS_READY = 0x01,
    SOFT_RESET = 0x80,        // control 2; clears itself
    NORMAL_200_HZ = 0x0D,     // control 1: oversampled 8 times, no further filter
    RANGE_SHIFT = 2,      // control 2: 30 G is 0, 12 G is 1, 8 G is 2, 2 G is 3
    GAIN_CODES = 4,
    LARGEST = 30000, // beyond it the chip reports overflow; far beyond, it stays at 32767 or -32768
};

// 0x80 at register 0 may also come from a potentiometer, which answers every read with its middle position: its "soft
// reset" stays set.
static enum bus_result qmc5883p_identify(const struct chip_wires *wires, uint8_t identification[3])
{
    enum bus_result result = chip_read(wires, PRODUCT, &identification[0], 1);
    identification[1] = ADDRESS;
    if (result == BUS_OK)
        result = chip_read(wires, CONTROL_2, &identification[2], 1);
    identification[2] &= SOFT_RESET;
    return result;
}

static bool qmc5883p_is_identification(const uint8_t identification[3])
{
    return identification[0] == PRODUCT_ID && identification[1] == ADDRESS && identification[2] == 0;
}

static uint8_t control_2(const struct chip_setup *setup)
{
    return (uint8_t)((GAIN_CODES - 1 - setup->gain_code) << RANGE_SHIFT); // set and reset stay on (bits 1-0)
}

static enum bus_result qmc5883p_set_up(const struct chip_wires *wires, const struct chip_setup *setup)
{
    const uint8_t signs[] = {SIGNS, SIGNS_OF_AXES};
    const uint8_t range[] = {CONTROL_2, control_2(setup)};
    const uint8_t mode[] = {CONTROL_1, NORMAL_200_HZ};
    enum bus_result result = chip_write(wires, signs, sizeof signs);
    if (result == BUS_OK)
        result = chip_write(wires, range, sizeof range);
    return result == BUS_OK ? chip_write(wires, mode, sizeof mode) : result;
}

static enum bus_result qmc5883p_check(const struct chip_wires *wires, const struct chip_setup *setup, bool *held)
{
    uint8_t bytes[2];
    enum bus_result result = chip_read(wires, CONTROL_1, bytes, sizeof bytes);
    *held = result == BUS_OK && bytes[0] == NORMAL_200_HZ && bytes[1] == control_2(setup);
    return result;
}

// One public driver alone (reznikmm/qmc5883p, which quotes the data sheet) says that reading the status clears READY.
// The data are read only if it is set, which is also right if reading the data clears it.
static enum bus_result qmc5883p_read_status(const struct chip_wires *wires, struct chip_sample *sample)
{
    uint8_t byte = 0;
    enum bus_result result = chip_read(wires, STATUS, &byte, 1);
    sample->status = byte & STATUS_READY ? CHIP_READY : 0;
    return result;
}

static enum bus_result qmc5883p_read_counts(const struct chip_wires *wires, int16_t counts[3])
{
    uint8_t data[6];
    enum bus_result result = chip_read(wires, DATA, data, sizeof data);
    for (int axis = 0; axis < 3 && result == BUS_OK; axis++)
        counts[axis] = chip_limited((int16_t)(data[2 * axis] | data[2 * axis + 1] << 8), LARGEST);
    return result;
}

static const struct chip_speed speeds[] = {{200, 5000}};

const struct chip chip_qmc5883p = {
    .gain_codes = 4,
    .speed_count = 1,
    .speeds = speeds,
    .identify = qmc5883p_identify,
    .is_identification = qmc5883p_is_identification,
    .set_up = qmc5883p_set_up,
    .check = qmc5883p_check,
    .read_status = qmc5883p_read_status,
    .read_counts = qmc5883p_read_counts,
};
