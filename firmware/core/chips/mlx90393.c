// The MLX90393 (Melexis data sheet 3901090393 rev. 006): commands, each answered by a status byte. The facts and what is
// unverified of them: daemon/fmfts/sensor/chips/mlx90393.py.
#include "chip.h"

enum {
    // Section 15.1; the lower four bits name z, y, x and temperature.
    ALL = 0x0F,
    NOTHING = 0x00,
    BURST = 0x10,
    SINGLE = 0x30,
    READ = 0x40,
    READ_REGISTER = 0x50,
    WRITE_REGISTER = 0x60,
    EXIT = 0x80,
    STATUS_BURST = 0x80, // section 15.2
    STATUS_SINGLE = 0x20,
    STATUS_ERROR = 0x10,
    STATUS_MODE_OR_ERROR = 0xF0,
    EXIT_US = 1000, // section 15.1.3: a measurement that is running ends first
    // Section 16.1.
    REGISTERS = 3,
    HALL_CONFIGURATION = 0x0C,
    HALL_BITS = 0x0F,
    ANALOG = 0x007F, // bits of register 0: gain in 6–4, HALLCONF in 3–0; the others keep the factory's values
    FINEST_GAIN_SEL = 7,
    INTERRUPT_PIN = 0x8000,
    BURST_OF_ALL = ALL << 6, // of register 1; burst rate 0 means no pause
    // Of register 2: RES 2 for all axes. With RES 0 and 1 a field beyond the range wraps around; with RES 2 the
    // converter's own end, ±22000 counts, is reached first (section 16.2.6).
    RESOLUTIONS = 2 << 9 | 2 << 7 | 2 << 5,
    ZERO = 0x8000, // of RES 2
    LARGEST = 21999,
    SINGLE_FILTER = 3,
};

// With OSR 0 and OSR2 0. DIG_FILT 0 and 1 are not permitted with this HALLCONF (table 18).
static const struct chip_speed speeds[] = {{38, 25910}, {73, 13622}, {133, 7478}, {226, 4406}};
static const uint8_t filters[] = {7, 6, 5, 4};

// Its registers cannot be read while it measures.
static enum bus_result read_register(const struct chip_wires *wires, uint8_t number, uint8_t answer[3])
{
    const uint8_t command[] = {READ_REGISTER, (uint8_t)(number << 2)};
    enum bus_result result = chip_write(wires, command, sizeof command);
    return result == BUS_OK ? wires->bus->read(wires->bus->context, wires->address, answer, 3) : result;
}

static enum bus_result write_register(const struct chip_wires *wires, uint8_t number, uint16_t value)
{
    const uint8_t command[] = {WRITE_REGISTER, (uint8_t)(value >> 8), (uint8_t)value, (uint8_t)(number << 2)};
    uint8_t status;
    enum bus_result result = chip_write(wires, command, sizeof command);
    return result == BUS_OK ? wires->bus->read(wires->bus->context, wires->address, &status, 1) : result;
}

static enum bus_result mlx90393_reset(const struct chip_wires *wires)
{
    uint8_t status;
    return chip_read(wires, EXIT, &status, 1);
}

// The chip has no identification: the driver checks the status after a command, and register 0, which holds HALLCONF.
// A chip that is still in a burst refuses, and is asked again.
static enum bus_result mlx90393_identify(const struct chip_wires *wires, uint8_t identification[3])
{
    enum bus_result result = mlx90393_reset(wires);
    return result == BUS_OK ? read_register(wires, 0, identification) : result;
}

static bool mlx90393_is_identification(const uint8_t identification[3])
{
    return (identification[0] & STATUS_MODE_OR_ERROR) == 0 && (identification[2] & HALL_BITS) == HALL_CONFIGURATION;
}

// What the registers should hold. analog: the value of register 0.
static uint16_t wanted(const struct chip_setup *setup, int number, uint16_t analog)
{
    uint16_t filter = setup->streams ? filters[setup->speed] : SINGLE_FILTER;
    if (number == 0)
        return (uint16_t)((analog & ~ANALOG) | (FINEST_GAIN_SEL - setup->gain_code) << 4 | HALL_CONFIGURATION);
    return (uint16_t)(number == 1 ? INTERRUPT_PIN | BURST_OF_ALL : RESOLUTIONS | filter << 2);
}

static enum bus_result holds(const struct chip_wires *wires, const struct chip_setup *setup, bool *held)
{
    enum bus_result result = BUS_OK;
    *held = true;
    for (uint8_t number = 0; number < REGISTERS && result == BUS_OK; number++) {
        uint8_t answer[3];
        result = read_register(wires, number, answer);
        uint16_t value = (uint16_t)(answer[1] << 8 | answer[2]);
        *held = *held && result == BUS_OK && !(answer[0] & STATUS_ERROR) && value == wanted(setup, number, value);
    }
    return result;
}

// The burst begins last, because the registers cannot be read during it; and only if they hold what was written, so
// that a burst proves the setup. Without a burst it measures once: after power-up or reset the status of the first
// measurement's command must be read back (Melexis rev. 002, page 16), and triggers are written to several chips at
// once.
static enum bus_result mlx90393_set_up(const struct chip_wires *wires, const struct chip_setup *setup)
{
    uint8_t answer[3];
    bool held = false;
    enum bus_result result = read_register(wires, 0, answer);
    uint16_t analog = (uint16_t)(answer[1] << 8 | answer[2]);
    if (result == BUS_OK && (answer[0] & STATUS_ERROR))
        return BUS_OK;
    for (uint8_t number = 0; number < REGISTERS && result == BUS_OK; number++)
        result = write_register(wires, number, wanted(setup, number, analog));
    if (result == BUS_OK)
        result = holds(wires, setup, &held);
    if (result == BUS_OK && held)
        result = chip_read(wires, (setup->streams ? BURST : SINGLE) | ALL, answer, 1);
    return result;
}

static enum bus_result mlx90393_check(const struct chip_wires *wires, const struct chip_setup *setup, bool *held)
{
    uint8_t status = 0;
    enum bus_result result = chip_read(wires, NOTHING, &status, 1);
    if (result != BUS_OK)
        return result;
    *held = setup->streams ? (status & (STATUS_BURST | STATUS_ERROR)) == STATUS_BURST : status & STATUS_SINGLE;
    return setup->streams || *held ? BUS_OK : holds(wires, setup, held);
}

// A measurement can be read once. Until the next one, the chip answers with an error.
static enum bus_result mlx90393_read_status(const struct chip_wires *wires, struct chip_sample *sample)
{
    uint8_t answer[9];
    enum bus_result result = chip_read(wires, READ | ALL, answer, sizeof answer);
    if (result != BUS_OK || (answer[0] & STATUS_ERROR)) {
        sample->status = 0;
        return result;
    }
    sample->status = CHIP_READY;
    sample->temperature_raw = (int16_t)(answer[1] << 8 | answer[2]); // 46244 at 25 °C, of 16 bits without a sign
    for (int axis = 0; axis < 3; axis++)
        sample->counts[axis] = chip_limited((answer[3 + 2 * axis] << 8 | answer[4 + 2 * axis]) - ZERO, LARGEST);
    return BUS_OK;
}

static const struct chip_trigger trigger = {
    .bytes = {SINGLE | ALL},
    .count = 1,
    .conversion_us = 2870,
    .wait_us = 3730, // 1.3 times: real chips take longer than the table says (Adafruit_MLX90393, issues 17 and 18)
    .rate_max_hz = 250,
};

const struct chip chip_mlx90393 = {
    .gain_codes = 6,
    .speed_count = sizeof speeds / sizeof *speeds,
    .fills_period = true,
    .asked_by_writing = true,
    .reset_us = EXIT_US,
    .speeds = speeds,
    .trigger = &trigger,
    .identify = mlx90393_identify,
    .is_identification = mlx90393_is_identification,
    .reset = mlx90393_reset,
    .set_up = mlx90393_set_up,
    .check = mlx90393_check,
    .read_status = mlx90393_read_status,
};
