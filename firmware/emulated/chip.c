// Sources: Honeywell's data sheet 900425 (registers, LOCK, RDY, self-test, the old gain of the sample after a change) as the
// public drivers PX4 hmc5883, ArduPilot AP_Compass_HMC5843 and Zephyr quote it. If the sources leave a choice open, it
// is a field of struct emulated_chip that a test may set.
#include "chip.h"

#include <math.h>
#include <string.h>

#include "../core/hmc5983.h"

static const uint64_t NEVER = UINT64_MAX;
static const double UT_PER_GAUSS = 100.0;
static const double SATURATING_UT = 2000.0;

enum {
    POWER_ON_CONFIG_A = 0x10,
    POWER_ON_CONFIG_B = 0x20,
    DATA_OVERWRITTEN = 0x10,
    SINGLE_NS = 6000000,
    READY_LOW_NS = 250000,
    COUNT_MAX = 2047,
};

void emulated_chip_power_on(struct emulated_chip *chip)
{
    chip->config_a = POWER_ON_CONFIG_A;
    chip->config_b = POWER_ON_CONFIG_B;
    chip->mode = HMC5983_IDLE; // the single measurement of power-on is long over
    memset(chip->data, 0, sizeof chip->data);
    chip->temperature_raw = 0;
    chip->ready = chip->overwritten = chip->mode_was_read = chip->old_gain_pending = false;
    chip->bytes_read = 0;
    chip->pointer = 0;
    chip->next_conversion_ns = NEVER;
}

static double uniform(struct emulated_chip *chip)
{
    chip->random ^= chip->random << 13;
    chip->random ^= chip->random >> 17;
    chip->random ^= chip->random << 5;
    return chip->random / 4294967296.0;
}

// Twelve uniform numbers add up to a variance of one.
static double gaussian(struct emulated_chip *chip)
{
    double sum = -6.0;
    for (int i = 0; i < 12; i++)
        sum += uniform(chip);
    return sum;
}

static uint64_t stretched(const struct emulated_chip *chip, double nominal_ns)
{
    return (uint64_t)(nominal_ns / (1.0 + chip->ppm * 1e-6));
}

static uint64_t period_ns(const struct emulated_chip *chip)
{
    static const double rate_hz[8] = {0.75, 1.5, 3, 7.5, 15, 30, 75, 220};
    return stretched(chip, 1e9 / rate_hz[chip->config_a >> 2 & 7]);
}

static int to_counts(double gauss, uint8_t gain_code)
{
    double counts = round(gauss * hmc5983_lsb_per_gauss[gain_code]);
    return fabs(counts) > COUNT_MAX ? HMC5983_OVERFLOW : (int)counts;
}

static int measure_axis(struct emulated_chip *chip, int axis, uint8_t gain_code)
{
    bool compensated = chip->config_a & HMC5983_TEMPERATURE_COMPENSATION;
    double sensitivity = (1.0 + chip->gain_error[axis]) * (compensated ? 1.0 : 1.0 - 0.003 * (chip->temperature_c - 25.0));
    double noise = chip->noise_ut > 0.0 ? chip->noise_ut * gaussian(chip) : 0.0;
    double field_ut = chip->saturated_axes >> axis & 1 ? SATURATING_UT : chip->field_ut[axis];
    double external = (field_ut + noise) / UT_PER_GAUSS * sensitivity;
    int bias = chip->config_a & 3;
    double strap = bias == HMC5983_BIAS_POSITIVE ? 1.0 : bias == HMC5983_BIAS_NEGATIVE ? -1.0 : 0.0;
    int first = to_counts(external, gain_code);
    if (strap == 0.0)
        return first;
    int second = to_counts(external + strap * chip->strap_gauss[axis] * sensitivity, gain_code);
    if (first == HMC5983_OVERFLOW || second == HMC5983_OVERFLOW)
        return HMC5983_OVERFLOW;
    return chip->strap_leaves_external ? second : second - first;
}

static void glide_until(struct emulated_chip *chip, uint64_t time_ns)
{
    if (chip->glided_ns >= chip->glide_until_ns || time_ns <= chip->glided_ns)
        return; // it has arrived
    bool arrived = time_ns >= chip->glide_until_ns;
    double share = (double)(time_ns - chip->glided_ns) / (double)(chip->glide_until_ns - chip->glided_ns);
    for (int axis = 0; axis < 3; axis++)
        chip->field_ut[axis] += (chip->glide_ut[axis] - chip->field_ut[axis]) * (arrived ? 1.0 : share);
    chip->glided_ns = time_ns;
}

void emulated_chip_glide(struct emulated_chip *chip, const double target_ut[3], uint64_t duration_ns)
{
    glide_until(chip, chip->now_ns);
    memcpy(duration_ns == 0 ? chip->field_ut : chip->glide_ut, target_ut, sizeof chip->field_ut);
    chip->glided_ns = chip->now_ns;
    chip->glide_until_ns = chip->now_ns + duration_ns;
}

static void convert(struct emulated_chip *chip)
{
    glide_until(chip, chip->next_conversion_ns);
    static const int axis_order[3] = {0, 2, 1};
    uint8_t gain_code = chip->old_gain_pending ? chip->old_gain_code : (uint8_t)(chip->config_b >> 5);
    chip->old_gain_pending = false;
    chip->conversions++;
    chip->last_conversion_ns = chip->next_conversion_ns;
    if (chip->bytes_read != 0 || chip->mode_was_read)
        return; // the outputs are locked: the old sample stays
    for (int i = 0; i < 3; i++) {
        int counts = measure_axis(chip, axis_order[i], gain_code);
        chip->data[2 * i] = (uint8_t)((unsigned)counts >> 8);
        chip->data[2 * i + 1] = (uint8_t)counts;
    }
    if (chip->config_a & HMC5983_TEMPERATURE_COMPENSATION)
        chip->temperature_raw = (int16_t)lround((chip->temperature_c - 25.0) * 128.0);
    chip->overwritten = chip->ready;
    chip->ready = true;
}

void emulated_chip_advance(struct emulated_chip *chip, uint64_t now_ns)
{
    chip->now_ns = now_ns;
    while (chip->next_conversion_ns <= now_ns) {
        if (chip->mode != HMC5983_CONTINUOUS) {
            chip->mode = HMC5983_IDLE;
            if (!chip->clock_stopped)
                convert(chip);
            chip->next_conversion_ns = NEVER;
            return;
        }
        uint64_t period = period_ns(chip), behind = (now_ns - chip->next_conversion_ns) / period;
        if (behind > 2)
            chip->next_conversion_ns += (behind - 2) * period; // skip most conversions when time jumps by hours
        if (!chip->clock_stopped)
            convert(chip);
        chip->next_conversion_ns += period;
    }
}

static void restart(struct emulated_chip *chip)
{
    if (chip->mode == HMC5983_CONTINUOUS) {
        chip->next_conversion_ns = chip->now_ns + 2 * period_ns(chip);
    } else if (chip->mode == HMC5983_SINGLE) {
        int acquisitions = chip->config_a & 3 ? 2 : 1;
        chip->next_conversion_ns = chip->now_ns + stretched(chip, (double)SINGLE_NS * acquisitions);
        chip->ready = false; // "until another measurement is performed"
    } else {
        chip->next_conversion_ns = NEVER;
    }
}

static void unlock(struct emulated_chip *chip)
{
    chip->bytes_read = 0;
    chip->mode_was_read = false;
}

static void write_register(struct emulated_chip *chip, uint8_t number, uint8_t value)
{
    if (chip->config_read_only && number != HMC5983_MODE)
        return;
    switch (number) {
    case HMC5983_CONFIG_A:
        chip->config_a = value;
        unlock(chip);
        if (chip->mode == HMC5983_CONTINUOUS)
            restart(chip);
        break;
    case HMC5983_CONFIG_B:
        if (!chip->old_gain_pending)
            chip->old_gain_code = chip->config_b >> 5;
        chip->old_gain_pending = chip->old_gain_code != value >> 5;
        chip->config_b = value & 0xE0;
        if (chip->mode == HMC5983_CONTINUOUS)
            restart(chip);
        break;
    case HMC5983_MODE:
        chip->mode = value & 3;
        unlock(chip);
        restart(chip);
        break;
    default:
        break; // read-only
    }
}

static uint8_t status(const struct emulated_chip *chip)
{
    bool low = !chip->clock_stopped && chip->next_conversion_ns != NEVER &&
               chip->next_conversion_ns - chip->now_ns < READY_LOW_NS;
    bool locked = chip->bytes_read != 0 || chip->mode_was_read;
    return (uint8_t)((chip->ready && !(low && !locked) ? HMC5983_READY : 0) | (locked ? HMC5983_LOCKED : 0) |
                     (chip->overwritten ? DATA_OVERWRITTEN : 0));
}

static uint8_t read_data(struct emulated_chip *chip, int index)
{
    chip->overwritten = false;
    chip->bytes_read |= (uint8_t)(1 << index);
    if (!chip->ready_survives_reading)
        chip->ready = false;
    if (chip->bytes_read == 0x3F)
        unlock(chip);
    return chip->data[index];
}

static uint8_t read_register(struct emulated_chip *chip, uint8_t number)
{
    switch (number) {
    case HMC5983_CONFIG_A:
        return chip->config_a;
    case HMC5983_CONFIG_B:
        return chip->config_b;
    case HMC5983_MODE:
        chip->mode_was_read = true;
        return chip->mode;
    case HMC5983_STATUS:
        return status(chip);
    case HMC5983_TEMPERATURE:
        return (uint8_t)((uint16_t)chip->temperature_raw >> 8);
    case HMC5983_TEMPERATURE + 1:
        return (uint8_t)chip->temperature_raw;
    default:
        break;
    }
    if (number >= HMC5983_DATA && number < HMC5983_STATUS)
        return read_data(chip, number - HMC5983_DATA);
    if (number >= HMC5983_IDENTIFICATION && number < HMC5983_IDENTIFICATION + 3)
        return (uint8_t)chip->identification[number - HMC5983_IDENTIFICATION];
    return 0;
}

// Data sheet, register access: after the last data register the pointer goes back to the first, so a burst from 0x03
// never reaches the status register.
static uint8_t next_pointer(uint8_t pointer)
{
    if (pointer == HMC5983_DATA + 5)
        return HMC5983_DATA;
    if (pointer == HMC5983_IDENTIFICATION + 2)
        return 0;
    return (uint8_t)(pointer + 1);
}

static void start_write(struct emulated_part *part)
{
    ((struct emulated_chip *)part)->pointer_expected = true;
}

static void put(struct emulated_part *part, uint8_t byte)
{
    struct emulated_chip *chip = (struct emulated_chip *)part;
    if (chip->pointer_expected) {
        chip->pointer = byte;
        chip->pointer_expected = false;
        return;
    }
    write_register(chip, chip->pointer, byte);
    chip->pointer = next_pointer(chip->pointer);
}

static uint8_t get(struct emulated_part *part)
{
    struct emulated_chip *chip = (struct emulated_chip *)part;
    uint8_t byte = read_register(chip, chip->pointer);
    chip->pointer = next_pointer(chip->pointer);
    return byte;
}

static void power_on(struct emulated_part *part)
{
    emulated_chip_power_on((struct emulated_chip *)part);
}

static void advance(struct emulated_part *part, uint64_t now_ns)
{
    emulated_chip_advance((struct emulated_chip *)part, now_ns);
}

void emulated_chip_init(struct emulated_chip *chip, uint32_t seed)
{
    static const struct emulated_part_kind kind = {power_on, advance, start_write, put, get};
    *chip = (struct emulated_chip){
        .part = {.kind = &kind, .address = HMC5983_ADDRESS, .present = true},
        .temperature_c = 25.0,
        .strap_gauss = {1.16, 1.16, 1.08},
        .identification = {'H', '4', '3'},
        .random = seed * 2654435761U + 1U,
    };
    emulated_chip_power_on(chip);
}
