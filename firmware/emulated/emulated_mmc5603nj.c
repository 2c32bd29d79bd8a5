// An MMC5603NJ as public drivers describe it: the Linux driver mmc5633, Zephyr drivers/sensor/memsic/mmc56x3,
// Adafruit_MMC56x3, mgershow/MMC5603NJ, PebbleOS. emulated_memsic.c has the film and its sources.
//
// Unverified: its handedness, the field that upsets its film, its noise at bandwidths other than 00, when it sets
// Sat_sensor, and that an automatic set/reset takes just twice the time (its fastest rates fit that).
#include "emulated_mmc5603nj.h"

#include <string.h>

enum {
    OUTPUT = 0x00, // Xout0 to Zout1: the upper 16 bits of each axis
    LOWEST_BITS = 0x06, // Xout2, Yout2, Zout2: the lower four in the upper nibble
    STATUS = 0x18,
    RATE = 0x1A,
    CONTROL_0 = 0x1B,
    PRODUCT_ID = 0x39,
    MEAS_M_DONE = 0x40,
    SAT_SENSOR = 0x20,
    OTP_READ_DONE = 0x10,
    AUTO_ST_EN = 0x40, // control 0
    CMM_FREQ_EN = 0x80,
    X_INHIBIT = 0x04, // control 1; y and z follow
    CMM_EN = 0x10, // control 2
    HPOWER = 0x80,
    ZERO = 1 << 19, // of 20 bits
};

static void restart(struct emulated_memsic *memsic)
{
    struct emulated_mmc5603nj *chip = (struct emulated_mmc5603nj *)memsic;
    memsic->common.registers[STATUS] = OTP_READ_DONE;
    memsic->common.registers[PRODUCT_ID] = 0x10;
    chip->rate_hz = 0;
    chip->period_ns = 0;
}

static uint64_t period_ns(struct emulated_memsic *memsic)
{
    const struct emulated_mmc5603nj *chip = (const struct emulated_mmc5603nj *)memsic;
    if (!(memsic->controls[2] & CMM_EN) || !chip->period_ns)
        return 0;
    uint64_t period = memsic->controls[2] & HPOWER && chip->rate_hz == 255 ? 1000000 : chip->period_ns;
    emulated_memsic_measurement_ns(memsic);
    uint64_t room_ns = memsic->automatic ? period / 2 : period;
    if (memsic->sample_ns > room_ns)
        memsic->sample_ns = (uint32_t)room_ns;
    return period;
}

static int coil_current(const struct emulated_memsic *memsic)
{
    return (memsic->controls[1] >> 5 & 1) - (memsic->controls[1] >> 6 & 1); // St_enp, St_enm
}

static void show(struct emulated_memsic *memsic, const int counts[3])
{
    uint8_t *registers = memsic->common.registers;
    bool saturated = memsic->upset;
    for (int axis = 0; axis < 3; axis++) {
        saturated |= counts[axis] == 0 || counts[axis] == 2 * ZERO - 1;
        if (memsic->controls[1] & X_INHIBIT << axis)
            continue;
        registers[OUTPUT + 2 * axis] = (uint8_t)(counts[axis] >> 12);
        registers[OUTPUT + 2 * axis + 1] = (uint8_t)(counts[axis] >> 4);
        registers[LOWEST_BITS + axis] = (uint8_t)(counts[axis] << 4);
    }
    if (memsic->controls[0] & AUTO_ST_EN)
        registers[STATUS] = (uint8_t)((registers[STATUS] & ~SAT_SENSOR) | (saturated ? SAT_SENSOR : 0));
}

static void put(struct emulated_part *part, uint8_t byte)
{
    static const uint8_t fastest_hz[4] = {75, 150, 255, 255}; // with automatic set/reset
    struct emulated_mmc5603nj *chip = (struct emulated_mmc5603nj *)part;
    if (magnetometer_takes_pointer(&chip->common, byte))
        return;
    uint8_t number = chip->common.pointer++;
    bool hears = emulated_memsic_hears(&chip->memsic);
    emulated_memsic_write(&chip->memsic, number, byte);
    if (number == RATE && hears) {
        chip->rate_hz = byte;
    } else if (number == CONTROL_0 && hears && byte & CMM_FREQ_EN && chip->rate_hz) {
        uint8_t fastest = fastest_hz[chip->memsic.controls[1] & 3];
        chip->period_ns = 1000000000U / (chip->rate_hz < fastest ? chip->rate_hz : fastest);
    }
}

static uint8_t get(struct emulated_part *part)
{
    struct emulated_mmc5603nj *chip = (struct emulated_mmc5603nj *)part;
    return emulated_memsic_read(&chip->memsic, chip->common.pointer++);
}

void emulated_mmc5603nj_init(struct emulated_mmc5603nj *chip, uint32_t seed)
{
    static const struct emulated_part_kind part = {emulated_memsic_power_on, magnetometer_advance,
                                                   magnetometer_start_write, put, get};
    static const struct emulated_memsic_kind kind = {
        .status = STATUS,
        .done = MEAS_M_DONE,
        .control_0 = CONTROL_0,
        .zero = ZERO,
        .counts_per_gauss = 16384,
        .upsetting_gauss = 32,
        .sample_ns = {6600000, 3500000, 2000000, 1200000},
        .noise_gauss = {2.0e-3, 2.75e-3, 3.63e-3, 4.69e-3}, // 2 mG (vendor), then by the square root of the time
        .settles_ns = 1000000,
        .reset_ns = 20000000,
        .restart = restart,
        .period_ns = period_ns,
        .coil_current = coil_current,
        .show = show,
    };
    memset(chip, 0, sizeof *chip);
    emulated_memsic_init(&chip->memsic, &kind, &part, seed);
}
