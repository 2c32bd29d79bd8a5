// A QMC5883L as QST's data sheet (13-52-04 rev. 1.0) describes it where public drivers quote it. PX4's and ArduPilot's read
// register 0x00 once before they ask for the identity.
#include "emulated_qmc5883l.h"

#include <math.h>
#include <string.h>

enum {
    OUTPUT = 0x00, // section 9.1: x, y, z, low byte first
    STATUS = 0x06,
    CONTROL_1 = 0x09,
    CONTROL_2 = 0x0A,
    PERIOD = 0x0B,
    IDENTIFICATION = 0x0D,
    DRDY = 0x01, // section 9.2.2
    OVL = 0x02,
    DOR = 0x04,
    MODE = 0x03, // section 9.2.3
    MODE_CONTINUOUS = 0x01,
    SOFT_RST = 0x80, // section 9.2.4
    ROL_PNT = 0x40,
    OUTPUT_LAST = 0x05,
};

static void reset(struct emulated_magnetometer *chip)
{
    magnetometer_clear(chip);
    chip->registers[IDENTIFICATION] = 0xFF;
}

static void power_on(struct emulated_part *part)
{
    reset((struct emulated_magnetometer *)part);
    ((struct emulated_qmc5883l *)part)->woken = false;
}

static uint64_t period_ns(const struct emulated_magnetometer *chip)
{
    static const uint16_t rate_hz[4] = {10, 50, 100, 200};
    return 1000000000U / rate_hz[chip->registers[CONTROL_1] >> 2 & 3];
}

static uint64_t convert(struct emulated_magnetometer *chip)
{
    static const double lsb_per_gauss[4] = {12000, 3000, 0, 0}; // section 2.2
    uint8_t status = chip->registers[STATUS] & DRDY ? DRDY | DOR : DRDY;
    for (int axis = 0; axis < 3; axis++) {
        double counts = magnetometer_gauss(chip, axis) * lsb_per_gauss[chip->registers[CONTROL_1] >> 4 & 3];
        int count = magnetometer_count(counts, -32768, 32767);
        double ends = ((struct emulated_qmc5883l *)chip)->overflow_gauss;
        if (counts > 32767 || counts < -32768 || (ends > 0.0 && fabs(chip->field_gauss[axis]) > ends))
            status |= OVL;
        chip->registers[OUTPUT + 2 * axis] = (uint8_t)count;
        chip->registers[OUTPUT + 2 * axis + 1] = (uint8_t)((unsigned)count >> 8);
    }
    chip->registers[STATUS] = status;
    return period_ns(chip);
}

static void put(struct emulated_part *part, uint8_t byte)
{
    struct emulated_magnetometer *chip = (struct emulated_magnetometer *)part;
    if (magnetometer_takes_pointer(chip, byte))
        return;
    uint8_t number = chip->pointer++;
    if (chip->writes_lost || number < CONTROL_1 || number > PERIOD)
        return;
    if (number == CONTROL_2 && (byte & SOFT_RST)) {
        reset(chip);
        return;
    }
    chip->registers[number] = byte;
    if (number == CONTROL_1) {
        magnetometer_end(chip);
        if ((byte & MODE) == MODE_CONTINUOUS)
            magnetometer_begin(chip, period_ns(chip));
    }
}

static uint8_t get(struct emulated_part *part)
{
    struct emulated_magnetometer *chip = (struct emulated_magnetometer *)part;
    uint8_t number = chip->pointer, byte = chip->registers[number];
    bool *woken = &((struct emulated_qmc5883l *)part)->woken;
    *woken |= number == OUTPUT;
    bool rolls_over = number == STATUS && (chip->registers[CONTROL_2] & ROL_PNT);
    chip->pointer = rolls_over ? OUTPUT : (uint8_t)(number + 1);
    if (number <= OUTPUT_LAST)
        chip->registers[STATUS] &= OVL; // reading any output clears DRDY and DOR
    return number == IDENTIFICATION && !*woken ? 0 : byte;
}

static double own_noise_gauss(const struct emulated_magnetometer *chip)
{
    (void)chip;
    return 2e-3; // at ±2 G; no other figure is known
}

void emulated_qmc5883l_init(struct emulated_qmc5883l *chip, uint32_t seed)
{
    static const struct emulated_part_kind kind = {power_on, magnetometer_advance, magnetometer_start_write, put, get};
    memset(chip, 0, sizeof *chip);
    magnetometer_init(&chip->common, &kind, 0x0D, convert, seed);
    chip->common.own_noise_gauss = own_noise_gauss;
    chip->common.sensitivity_per_k = -5e-4;
}
