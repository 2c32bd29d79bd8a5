#include "emulated_mmc5983ma.h"

#include <math.h>
#include <string.h>

enum {
    OUTPUT = 0x00, // Xout0 to Zout1: the upper 16 bits of each axis; then the lower two of all three
    STATUS = 0x08,
    CONTROL_0 = 0x09,
    CONTROL_1 = 0x0A,
    CONTROL_3 = 0x0C,
    PRODUCT_ID = 0x2F,
    MEAS_M_DONE = 0x01,
    MEAS_T_DONE = 0x02,
    OTP_READ_DONE = 0x10,
    TM_M = 0x01,
    SET = 0x08,
    RESET = 0x10,
    AUTO_SR_EN = 0x20,
    SW_RST = 0x80,
    CMM_EN = 0x08,
    CM_FREQ = 0x07,
    EN_PRD_SET = 0x80,
    ZERO = 0x20000, // of 18 bits
    COUNTS_PER_GAUSS = 16384,
    POWER_ON_NS = 9000000, // "10 ms" is what the host has to wait
};

static const double MAGNETISING_GAUSS = 10.0, REMANENCE_GAUSS = 0.3;

static void power_on(struct emulated_part *part)
{
    struct emulated_mmc5983ma *chip = (struct emulated_mmc5983ma *)part;
    magnetometer_clear(&chip->common);
    memset(chip->controls, 0, sizeof chip->controls);
    chip->common.registers[STATUS] = OTP_READ_DONE;
    chip->common.registers[PRODUCT_ID] = 0x30;
    chip->starts_until_ns = 0;
}

static uint64_t measurement_ns(const struct emulated_mmc5983ma *chip)
{
    static const uint32_t of_bandwidth[4] = {8000000, 4000000, 2000000, 500000};
    return of_bandwidth[chip->controls[1] & 3];
}

// Of continuous measurements; 0: there are none. One that is longer than its period takes the next one.
static uint64_t period_ns(const struct emulated_mmc5983ma *chip)
{
    static const uint16_t rate_hz[8] = {0, 1, 10, 20, 50, 100, 200, 1000};
    uint16_t rate = rate_hz[chip->controls[2] & CM_FREQ];
    if (!(chip->controls[2] & CMM_EN) || rate == 0)
        return 0;
    uint64_t period = 1000000000U / rate;
    return (measurement_ns(chip) + period - 1) / period * period;
}

static uint64_t convert(struct emulated_magnetometer *common)
{
    struct emulated_mmc5983ma *chip = (struct emulated_mmc5983ma *)common;
    double gauss[3], strongest = 0;
    for (int axis = 0; axis < 3; axis++) {
        gauss[axis] = magnetometer_gauss(common, axis) * (axis == 2 ? -1 : 1); // left-handed: z points into the board
        strongest = fmax(strongest, fabs(gauss[axis]));
    }
    // "Automatic set/reset" is a SET before a measurement; in a stream, with EN_PRD_SET, every PRD_SET measurements,
    // here each.
    if ((chip->controls[0] & AUTO_SR_EN) && (!period_ns(chip) || (chip->controls[2] & EN_PRD_SET)))
        chip->magnetised = false;
    chip->magnetised |= strongest > MAGNETISING_GAUSS;
    common->registers[OUTPUT + 6] = 0;
    for (int axis = 0; axis < 3; axis++) {
        double offset = chip->magnetised ? REMANENCE_GAUSS : 0.0;
        int count = magnetometer_count(ZERO + (gauss[axis] + offset) * COUNTS_PER_GAUSS, 0, 2 * ZERO - 1);
        common->registers[OUTPUT + 2 * axis] = (uint8_t)(count >> 10);
        common->registers[OUTPUT + 2 * axis + 1] = (uint8_t)(count >> 2);
        common->registers[OUTPUT + 6] |= (uint8_t)((count & 3) << (6 - 2 * axis));
    }
    common->registers[STATUS] |= MEAS_M_DONE;
    return period_ns(chip);
}

static void control(struct emulated_mmc5983ma *chip, int number, uint8_t value)
{
    chip->controls[number] = value;
    if (number == 0) {
        chip->controls[0] &= AUTO_SR_EN; // the bits that start something clear themselves
        if (value & (SET | RESET))
            chip->magnetised = false;
        if (value & TM_M) {
            chip->common.registers[STATUS] &= (uint8_t)~MEAS_M_DONE;
            magnetometer_begin(&chip->common, measurement_ns(chip));
        }
    } else if (number == 2) {
        magnetometer_end(&chip->common);
        if (period_ns(chip))
            magnetometer_begin(&chip->common, period_ns(chip));
    }
}

static void put(struct emulated_part *part, uint8_t byte)
{
    struct emulated_mmc5983ma *chip = (struct emulated_mmc5983ma *)part;
    struct emulated_magnetometer *common = &chip->common;
    if (magnetometer_takes_pointer(common, byte)) {
        memcpy(chip->held, common->registers, sizeof chip->held);
        return;
    }
    uint8_t number = common->pointer++;
    if (common->now_ns < chip->starts_until_ns || common->writes_lost)
        return;
    if (number == STATUS) {
        common->registers[STATUS] &= (uint8_t)~(byte & (MEAS_M_DONE | MEAS_T_DONE));
    } else if (number == CONTROL_1 && (byte & SW_RST)) {
        power_on(part);
        chip->starts_until_ns = common->now_ns + POWER_ON_NS;
    } else if (number >= CONTROL_0 && number <= CONTROL_3) {
        control(chip, number - CONTROL_0, byte);
    }
}

static uint8_t get(struct emulated_part *part)
{
    struct emulated_mmc5983ma *chip = (struct emulated_mmc5983ma *)part;
    uint8_t number = chip->common.pointer++;
    if (chip->holds_outputs && number < sizeof chip->held)
        return chip->held[number];
    return chip->common.registers[number]; // of the controls: zero
}

void emulated_mmc5983ma_init(struct emulated_mmc5983ma *chip, uint32_t seed)
{
    static const struct emulated_part_kind kind = {power_on, magnetometer_advance, magnetometer_start_write, put, get};
    memset(chip, 0, sizeof *chip);
    magnetometer_init(&chip->common, &kind, 0x30, convert, seed);
    chip->common.sensitivity_per_k = -2e-4;
}
