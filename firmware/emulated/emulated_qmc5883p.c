// A QMC5883P as public drivers describe it: ArduPilot AP_Compass_QMC5883P, Adafruit_QMC5883P, lionyhw/MQC5883P_nrf52 and
// reznikmm/qmc5883p, which quotes the data sheet (OVFL is set beyond ±30000 counts, the outputs saturate at -32768 and 32767).
// That driver alone says that reading the status clears DRDY and OVFL; a test may choose.
//
// Unverified: which axes are turned before 0x29 = 0x06 was written, how long a single
// measurement takes, how fast mode "continuous" is, the noise at other ranges than ±2 G, the effect of warmth.
#include "emulated_qmc5883p.h"

#include <string.h>

enum {
    CHIP_ID = 0x00,
    OUTPUT = 0x01, // x, y, z, low byte first
    OUTPUT_LAST = 0x06,
    STATUS = 0x09,
    CONTROL_1 = 0x0A,
    CONTROL_2 = 0x0B,
    SIGNS = 0x29,
    DRDY = 0x01,
    OVFL = 0x02,
    MODE = 0x03,
    SUSPEND = 0,
    SINGLE = 2,
    CONTINUOUS = 3,
    SOFT_RST = 0x80,
    DEFINED_SIGNS = 0x06,
    OVERFLOWS = 30000,
    FASTEST_NS = 5000000, // a period of the highest rate of mode "normal"
};

static void power_on(struct emulated_part *part)
{
    struct emulated_qmc5883p *chip = (struct emulated_qmc5883p *)part;
    magnetometer_clear(&chip->common);
    chip->common.registers[CHIP_ID] = 0x80;
    chip->signs_defined = false;
}

static uint64_t period_ns(const struct emulated_magnetometer *chip)
{
    static const uint16_t rate_hz[4] = {10, 50, 100, 200};
    unsigned mode = chip->registers[CONTROL_1] & MODE;
    return mode == SINGLE || mode == CONTINUOUS ? FASTEST_NS : 1000000000U / rate_hz[chip->registers[CONTROL_1] >> 2 & 3];
}

static uint64_t convert(struct emulated_magnetometer *common)
{
    static const double lsb_per_gauss[4] = {1000, 2500, 3750, 15000};
    struct emulated_qmc5883p *chip = (struct emulated_qmc5883p *)common;
    uint8_t *registers = common->registers, status = (registers[STATUS] & OVFL) | DRDY;
    for (int axis = 0; axis < 3; axis++) {
        double turned = chip->signs_defined || axis == 2 ? 1.0 : -1.0;
        double counts = turned * magnetometer_gauss(common, axis) * lsb_per_gauss[registers[CONTROL_2] >> 2 & 3];
        int count = magnetometer_count(counts, -32768, 32767);
        if (count > OVERFLOWS || count < -OVERFLOWS)
            status |= OVFL;
        registers[OUTPUT + 2 * axis] = (uint8_t)count;
        registers[OUTPUT + 2 * axis + 1] = (uint8_t)((unsigned)count >> 8);
    }
    registers[STATUS] = status;
    if ((registers[CONTROL_1] & MODE) != SINGLE)
        return period_ns(common);
    registers[CONTROL_1] &= (uint8_t)~MODE; // then the chip returns to suspend
    return 0;
}

static void put(struct emulated_part *part, uint8_t byte)
{
    struct emulated_qmc5883p *chip = (struct emulated_qmc5883p *)part;
    struct emulated_magnetometer *common = &chip->common;
    if (magnetometer_takes_pointer(common, byte))
        return;
    uint8_t number = common->pointer++;
    if (common->writes_lost)
        return;
    if (number == CONTROL_2 && (byte & SOFT_RST)) {
        power_on(part);
    } else if (number == SIGNS) {
        chip->signs_defined = byte == DEFINED_SIGNS; // the register cannot be read back
    } else if (number == CONTROL_1 || number == CONTROL_2) {
        common->registers[number] = byte;
        if (number == CONTROL_1) {
            magnetometer_end(common);
            if ((byte & MODE) != SUSPEND)
                magnetometer_begin(common, period_ns(common));
        }
    }
}

static uint8_t get(struct emulated_part *part)
{
    struct emulated_qmc5883p *chip = (struct emulated_qmc5883p *)part;
    uint8_t *registers = chip->common.registers, number = chip->common.pointer++, byte = registers[number];
    if (number == STATUS)
        registers[STATUS] &= chip->cleared_by_data ? DRDY : 0;
    else if (number >= OUTPUT && number <= OUTPUT_LAST && chip->cleared_by_data)
        registers[STATUS] &= OVFL;
    return byte;
}

static double own_noise_gauss(const struct emulated_magnetometer *chip)
{
    (void)chip;
    return 2e-3; // like the QMC5883L at ±2 G
}

void emulated_qmc5883p_init(struct emulated_qmc5883p *chip, uint32_t seed)
{
    static const struct emulated_part_kind kind = {power_on, magnetometer_advance, magnetometer_start_write, put, get};
    memset(chip, 0, sizeof *chip);
    magnetometer_init(&chip->common, &kind, 0x2C, convert, seed);
    chip->common.own_noise_gauss = own_noise_gauss;
    chip->common.sensitivity_per_k = -5e-4;
}
