// Sources: MEMSIC's data sheet rev. A (read; pages beside the registers) and users of SparkFun's library (issues 9, 10, 12).
// emulated_memsic.c names those of the film.
#include "emulated_mmc5983ma.h"

#include <string.h>

enum {
    OUTPUT = 0x00, // Xout0 to Zout1: the upper 16 bits of each axis (page 13); then the lower two of all three
    LOWEST_BITS = 0x06,
    STATUS = 0x08, // page 14
    CONTROL_0 = 0x09,
    PRODUCT_ID = 0x2F,
    MEAS_M_DONE = 0x01,
    OTP_READ_DONE = 0x10,
    X_INHIBIT = 0x04, // control 1, page 15
    YZ_INHIBIT = 0x18,
    CMM_EN = 0x08, // control 2, page 16
    CM_FREQ = 0x07,
    ZERO = 1 << 17, // of 18 bits
    ODD_COUNTS = 1802, // 11 uT
};

static void restart(struct emulated_memsic *memsic)
{
    memsic->common.registers[STATUS] = OTP_READ_DONE;
    memsic->common.registers[PRODUCT_ID] = 0x30;
    ((struct emulated_mmc5983ma *)memsic)->asked_exactly = 0;
}

// A measurement longer than its period skips to the end of the next one. Unverified: Prd_set changes nothing.
static uint64_t period_ns(struct emulated_memsic *memsic)
{
    static const uint16_t rate_hz[8] = {0, 1, 10, 20, 50, 100, 200, 1000};
    static const uint16_t fastest_hz[4] = {50, 100, 225, 580}; // with automatic set/reset, page 2
    uint16_t rate = rate_hz[memsic->controls[2] & CM_FREQ];
    if (!(memsic->controls[2] & CMM_EN) || rate == 0)
        return 0;
    uint64_t nominal_ns = 1000000000U / rate;
    uint64_t taken_ns = (emulated_memsic_measurement_ns(memsic) + nominal_ns - 1) / nominal_ns * nominal_ns;
    uint64_t least_ns = memsic->automatic ? 1000000000U / fastest_hz[memsic->controls[1] & 3] : 0;
    return taken_ns > least_ns ? taken_ns : least_ns;
}

static int coil_current(const struct emulated_memsic *memsic)
{
    return (memsic->controls[3] >> 1 & 1) - (memsic->controls[3] >> 2 & 1); // St_enp, St_enm
}

static void show(struct emulated_memsic *memsic, const int counts[3])
{
    struct emulated_mmc5983ma *chip = (struct emulated_mmc5983ma *)memsic;
    uint8_t *registers = memsic->common.registers;
    bool odd = memsic->exactly && ++chip->asked_exactly % 16 == 0;
    memsic->exactly = false;
    for (int axis = 0; axis < 3; axis++) {
        uint8_t inhibits = axis ? YZ_INHIBIT : X_INHIBIT;
        int count = counts[axis] + (odd && axis == 0 ? ODD_COUNTS : 0);
        count = count < 2 * ZERO ? count : 2 * ZERO - 1;
        if ((memsic->controls[1] & inhibits) == inhibits)
            continue;
        registers[OUTPUT + 2 * axis] = (uint8_t)(count >> 10);
        registers[OUTPUT + 2 * axis + 1] = (uint8_t)(count >> 2);
        registers[LOWEST_BITS] &= (uint8_t)~(3 << (6 - 2 * axis));
        registers[LOWEST_BITS] |= (uint8_t)((count & 3) << (6 - 2 * axis));
    }
}

static void put(struct emulated_part *part, uint8_t byte)
{
    struct emulated_mmc5983ma *chip = (struct emulated_mmc5983ma *)part;
    if (magnetometer_takes_pointer(&chip->common, byte))
        memcpy(chip->held, chip->common.registers, sizeof chip->held);
    else
        emulated_memsic_write(&chip->memsic, chip->common.pointer++, byte);
}

static uint8_t get(struct emulated_part *part)
{
    struct emulated_mmc5983ma *chip = (struct emulated_mmc5983ma *)part;
    uint8_t number = chip->common.pointer++;
    if (chip->holds_outputs && number < sizeof chip->held)
        return chip->held[number];
    return emulated_memsic_read(&chip->memsic, number);
}

void emulated_mmc5983ma_init(struct emulated_mmc5983ma *chip, uint32_t seed)
{
    static const struct emulated_part_kind part = {emulated_memsic_power_on, magnetometer_advance,
                                                   magnetometer_start_write, put, get};
    static const struct emulated_memsic_kind kind = {
        .status = STATUS,
        .done = MEAS_M_DONE,
        .control_0 = CONTROL_0,
        .zero = ZERO,
        .counts_per_gauss = 16384,
        .upsetting_gauss = 10,                              // page 2
        .sample_ns = {8000000, 4000000, 2000000, 500000},   // page 15
        .noise_gauss = {0.4e-3, 0.6e-3, 0.8e-3, 1.2e-3},    // page 2
        .between_pulses_ns = 1000000,
        .settles_ns = 500000,
        .reset_ns = 10000000, // page 15
        .restart = restart,
        .period_ns = period_ns,
        .coil_current = coil_current,
        .show = show,
    };
    memset(chip, 0, sizeof *chip);
    emulated_memsic_init(&chip->memsic, &kind, &part, seed);
}
