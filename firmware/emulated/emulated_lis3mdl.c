// Sources: public drivers (PX4 lis3mdl, ArduPilot AP_Compass_LIS3MDL, Adafruit_LIS3MDL, Zephyr's lis3mdl) and ST's AN4602 as
// they quote it. The data sheet (DocID024204 rev. 6) could not be read: facts that no driver states are from memory.
#include "emulated_lis3mdl.h"

#include <math.h>
#include <string.h>

enum {
    WHO_AM_I = 0x0F,
    CTRL_1 = 0x20,
    CTRL_2 = 0x21,
    CTRL_3 = 0x22,
    CTRL_5 = 0x24,
    STATUS = 0x27,
    OUTPUT = 0x28,
    OUTPUT_BYTES = 6,
    TEMPERATURE = 0x2E,
    ADVANCE = 0x80, // bit of the sub-address (section 5.1.1)
    TEMP_EN = 0x80,
    FAST_ODR = 0x02,
    SOFT_RST = 0x04,
    MODE = 0x03,
    MODE_CONTINUOUS = 0,
    MODE_SINGLE = 1,
    MODE_OFF = 3,
    BDU = 0x40,
    ZYXDA = 0x08,
    AXES_NEW = 0x0F,
    AXES_OVERRUN = 0xF0,
};

static void power_on(struct emulated_part *part)
{
    struct emulated_lis3mdl *chip = (struct emulated_lis3mdl *)part;
    magnetometer_clear(&chip->common);
    chip->common.registers[WHO_AM_I] = 0x3D;
    chip->common.registers[CTRL_1] = 0x10;
    chip->common.registers[CTRL_3] = MODE_OFF;
    chip->unread = 0;
}

static uint64_t period_ns(const struct emulated_lis3mdl *chip)
{
    static const double rate_hz[8] = {0.625, 1.25, 2.5, 5, 10, 20, 40, 80}; // table 20
    static const double fast_hz[4] = {1000, 560, 300, 155};                // table 21, for the performance of x and y
    uint8_t first = chip->common.registers[CTRL_1];
    return (uint64_t)(1e9 / (first & FAST_ODR ? fast_hz[first >> 5 & 3] : rate_hz[first >> 2 & 7]));
}

// For the performance (application note AN4602).
static uint64_t single_ns(const struct emulated_lis3mdl *chip)
{
    static const uint32_t us[4] = {1200, 1650, 3230, 6400};
    return us[chip->common.registers[CTRL_1] >> 5 & 3] * 1000ULL;
}

static void measure(struct emulated_magnetometer *common)
{
    static const double lsb_per_gauss[4] = {6842, 3421, 2281, 1711}; // table 3
    for (int axis = 0; axis < 3; axis++) {
        double lsb = lsb_per_gauss[common->registers[CTRL_2] >> 5 & 3];
        int count = magnetometer_count(magnetometer_gauss(common, axis) * lsb, -32768, 32767);
        common->registers[OUTPUT + 2 * axis] = (uint8_t)count;
        common->registers[OUTPUT + 2 * axis + 1] = (uint8_t)((unsigned)count >> 8);
    }
}

static uint64_t convert(struct emulated_magnetometer *common)
{
    struct emulated_lis3mdl *chip = (struct emulated_lis3mdl *)common;
    // With BDU the outputs do not change between the bytes of one reading (section 7.6).
    bool being_read = chip->unread != 0 && chip->unread != (1 << OUTPUT_BYTES) - 1;
    if (!being_read || !(common->registers[CTRL_5] & BDU)) {
        measure(common);
        common->registers[STATUS] = common->registers[STATUS] & ZYXDA ? AXES_NEW | AXES_OVERRUN : AXES_NEW;
        chip->unread = (1 << OUTPUT_BYTES) - 1;
    }
    if (common->registers[CTRL_1] & TEMP_EN) {
        int raw = (int)lround((common->temperature_c - 25.0) * 8);
        common->registers[TEMPERATURE] = (uint8_t)raw;
        common->registers[TEMPERATURE + 1] = (uint8_t)((unsigned)raw >> 8);
    }
    if ((common->registers[CTRL_3] & MODE) == MODE_CONTINUOUS)
        return period_ns(chip);
    common->registers[CTRL_3] |= MODE_OFF; // a single conversion ends in power-down
    return 0;
}

static void configured(struct emulated_lis3mdl *chip)
{
    struct emulated_magnetometer *common = &chip->common;
    magnetometer_end(common);
    if ((common->registers[CTRL_3] & MODE) == MODE_CONTINUOUS)
        magnetometer_begin(common, period_ns(chip));
    else if ((common->registers[CTRL_3] & MODE) == MODE_SINGLE)
        magnetometer_begin(common, single_ns(chip));
}

// After the last output the register number returns to the first, so temperature needs a transfer of its own.
static void advance_pointer(struct emulated_magnetometer *common)
{
    if (common->pointer & ADVANCE)
        common->pointer = common->pointer == (ADVANCE | (OUTPUT + OUTPUT_BYTES - 1)) ? ADVANCE | OUTPUT
                                                                                    : (uint8_t)(common->pointer + 1);
}

static void put(struct emulated_part *part, uint8_t byte)
{
    struct emulated_lis3mdl *chip = (struct emulated_lis3mdl *)part;
    struct emulated_magnetometer *common = &chip->common;
    if (magnetometer_takes_pointer(common, byte))
        return;
    uint8_t number = common->pointer & 0x7F;
    advance_pointer(common);
    if (common->writes_lost || number < CTRL_1 || number > CTRL_5)
        return;
    if (number == CTRL_2 && (byte & SOFT_RST)) {
        power_on(part);
        return;
    }
    common->registers[number] = byte;
    if (number == CTRL_1 || number == CTRL_3)
        configured(chip);
}

static uint8_t get(struct emulated_part *part)
{
    struct emulated_lis3mdl *chip = (struct emulated_lis3mdl *)part;
    struct emulated_magnetometer *common = &chip->common;
    uint8_t number = common->pointer & 0x7F, byte = common->registers[number];
    advance_pointer(common);
    if (number >= OUTPUT && number < OUTPUT + OUTPUT_BYTES) {
        chip->unread &= (uint8_t)~(1 << (number - OUTPUT));
        if (chip->unread == 0)
            common->registers[STATUS] = 0;
    }
    return byte;
}

void emulated_lis3mdl_init(struct emulated_lis3mdl *chip, uint8_t address, uint32_t seed)
{
    static const struct emulated_part_kind kind = {power_on, magnetometer_advance, magnetometer_start_write, put, get};
    memset(chip, 0, sizeof *chip);
    magnetometer_init(&chip->common, &kind, address, convert, seed);
    chip->common.sensitivity_per_k = -3e-4;
}
