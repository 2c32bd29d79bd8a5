// The LIS3MDL (ST data sheet DocID024204 rev. 6, note AN4602). The facts and what is unverified of them:
// daemon/fmfts/sensor/chips/lis3mdl.py.
#include "chip.h"

enum {
    ADVANCE = 0x80, // the top bit of a register's number makes it advance (section 5.1.1)
    WHO_AM_I = 0x0F,
    CONTROL_1 = 0x20,
    CONTROL_3 = 0x22,
    CONTROLS = 5,
    MODE_CONTROL = 2, // of these five
    STATUS = 0x27,
    AXES = 0x28, // x, y, z; low byte first
    TEMPERATURE = 0x2E,
    IDENTIFICATION = 0x3D,
    STATUS_READY = 0x08,   // all three axes are new
    THERMOMETER_ON = 0x80, // CTRL_REG1; performance in bits 6–5, output rate in 4–2
    FAST = 0x02,
    BLOCK_UPDATE = 0x40, // CTRL_REG5: high and low byte of a sample always belong together
    MODE_CONTINUOUS = 0,
    MODE_SINGLE = 1,
    MODE_OFF = 3,
    RATE_80_HZ = 7 << 2,
    HIGH = 2, // performance: of x and y in CTRL_REG1, of z in CTRL_REG4
    ULTRA_HIGH = 3,
    LARGEST = 27366, // the full scale: readings beyond it are not specified
};

static const struct chip_speed speeds[] = {{80, 12500}, {155, 6452}, {300, 3333}}; // table 21
static const uint8_t performances[] = {ULTRA_HIGH, ULTRA_HIGH, HIGH};
static const uint8_t rates[] = {RATE_80_HZ, FAST, FAST};

static void configuration(const struct chip_setup *setup, uint8_t controls[CONTROLS])
{
    uint8_t speed = setup->streams ? setup->speed : 0; // table 24: single conversions go with 80 Hz and less
    controls[0] = (uint8_t)(THERMOMETER_ON | performances[speed] << 5 | rates[speed]);
    controls[1] = (uint8_t)(setup->gain_code << 5);
    controls[MODE_CONTROL] = setup->streams ? MODE_CONTINUOUS : MODE_OFF;
    controls[3] = (uint8_t)(performances[speed] << 2);
    controls[4] = BLOCK_UPDATE;
}

static enum bus_result lis3mdl_identify(const struct chip_wires *wires, uint8_t identification[3])
{
    identification[1] = identification[2] = 0;
    return chip_read(wires, WHO_AM_I, identification, 1);
}

static bool lis3mdl_is_identification(const uint8_t identification[3])
{
    return identification[0] == IDENTIFICATION && identification[1] == 0 && identification[2] == 0;
}

static enum bus_result lis3mdl_set_up(const struct chip_wires *wires, const struct chip_setup *setup)
{
    uint8_t bytes[1 + CONTROLS] = {ADVANCE | CONTROL_1};
    configuration(setup, bytes + 1);
    return chip_write(wires, bytes, sizeof bytes);
}

static enum bus_result lis3mdl_check(const struct chip_wires *wires, const struct chip_setup *setup, bool *held)
{
    uint8_t wanted[CONTROLS], found[CONTROLS];
    enum bus_result result = chip_read(wires, ADVANCE | CONTROL_1, found, sizeof found);
    configuration(setup, wanted);
    *held = result == BUS_OK;
    for (int i = 0; i < CONTROLS && *held; i++) // a single measurement may still run, so that its mode is not "off" yet
        *held = found[i] == wanted[i] || (i == MODE_CONTROL && !setup->streams);
    return result;
}

static enum bus_result lis3mdl_read_status(const struct chip_wires *wires, struct chip_sample *sample)
{
    uint8_t status = 0;
    enum bus_result result = chip_read(wires, STATUS, &status, 1);
    sample->status = status & STATUS_READY ? CHIP_READY : 0;
    return result;
}

static enum bus_result lis3mdl_read_counts(const struct chip_wires *wires, int16_t counts[3])
{
    uint8_t data[6];
    enum bus_result result = chip_read(wires, ADVANCE | AXES, data, sizeof data);
    for (int axis = 0; axis < 3 && result == BUS_OK; axis++)
        counts[axis] = chip_limited((int16_t)(data[2 * axis] | data[2 * axis + 1] << 8), LARGEST);
    return result;
}

// A separate transfer: if a read continued from the axes, these registers would repeat the x axis.
static enum bus_result lis3mdl_read_thermometer(const struct chip_wires *wires, int16_t *raw)
{
    uint8_t data[2];
    enum bus_result result = chip_read(wires, ADVANCE | TEMPERATURE, data, sizeof data);
    if (result == BUS_OK)
        *raw = (int16_t)(data[0] | data[1] << 8);
    return result;
}

static const struct chip_trigger trigger = {
    .bytes = {CONTROL_3, MODE_SINGLE},
    .count = 2,
    .conversion_us = 6500,
    .wait_us = 7200,
    .rate_max_hz = 80,
};

const struct chip chip_lis3mdl = {
    .gain_codes = 4,
    .speed_count = sizeof speeds / sizeof *speeds,
    .speeds = speeds,
    .trigger = &trigger,
    .identify = lis3mdl_identify,
    .is_identification = lis3mdl_is_identification,
    .set_up = lis3mdl_set_up,
    .check = lis3mdl_check,
    .read_status = lis3mdl_read_status,
    .read_counts = lis3mdl_read_counts,
    .read_thermometer = lis3mdl_read_thermometer,
};
