// An MLX90393 as Melexis' data sheet (3901090393) and public drivers describe it: commands in place of registers.
//
// Rev. 002 could be read in part: page 13 (order of the axes: t, x, y, z) and page 16 (the status of the first SM after
// power-up or reset has to be read back). Sections and tables of rev. 006 that public drivers do not quote are from memory.
// Adafruit_MLX90393 issues 17 and 18: real parts take longer than the table says; tedyapo waits 1.3 times as long.
// Unverified: that SB needs its status read as SM does; what a measurement without that shows (here: no field, and no
// error); where in a conversion the 490 us lie that belong to no axis (here: 100 us after z, the rest before t).
#include "emulated_mlx90393.h"

#include <math.h>
#include <string.h>

enum {
    // Commands (section 15.1); the lower nibble names z, y, x and t.
    START_BURST = 0x10,
    START_SINGLE = 0x30,
    READ_MEASUREMENT = 0x40,
    READ_REGISTER = 0x50,
    WRITE_REGISTER = 0x60,
    EXIT = 0x80,
    RESET = 0xF0,
    // Status (section 15.2).
    MODE_BURST = 0x80,
    MODE_SINGLE = 0x20,
    ERROR = 0x10,
    RS = 0x04,
    FACTORY = 0x0600, // upper bits of word 0; other values change the sensitivity
    HALLCONF = 0x0C,
    NO_AXIS_US = 490,
    AFTER_Z_US = 100,
    CONVERTER_END = 88000, // last count of 19 bits: 22000 counts of RES 2
    EXIT_NS = 900000,      // a measurement that is running ends first
};

static void power_on(struct emulated_part *part)
{
    struct emulated_mlx90393 *chip = (struct emulated_mlx90393 *)part;
    magnetometer_clear(&chip->common);
    memset(chip->words, 0, sizeof chip->words);
    chip->words[0] = FACTORY | 7 << 4 | HALLCONF;
    chip->mode = 0;
    chip->was_reset = true;
    chip->has_sample = chip->exits = false;
    chip->acknowledged = chip->start_unread = false;
    chip->command_count = chip->answer_count = chip->answer_sent = 0;
}

static unsigned axis_us(const struct emulated_mlx90393 *chip)
{
    unsigned osr = chip->words[2] & 3, filter = chip->words[2] >> 2 & 7;
    return 67 + (64U << osr) * (2 + (1U << filter));
}

static unsigned axis_count(const struct emulated_mlx90393 *chip)
{
    return (chip->axes >> 1 & 1U) + (chip->axes >> 2 & 1U) + (chip->axes >> 3 & 1U);
}

static uint64_t slowed_ns(const struct emulated_mlx90393 *chip, unsigned us)
{
    return (uint64_t)(chip->slowness * us * 1e3);
}

static uint64_t conversion_ns(const struct emulated_mlx90393 *chip)
{
    unsigned osr2 = chip->words[2] >> 11 & 3, us = axis_count(chip) * axis_us(chip) + NO_AXIS_US;
    return slowed_ns(chip, chip->axes & 1 ? us + 67 + (192U << osr2) : us);
}

// Table 17, HALLCONF 0xC: microtesla of a count at RES 0 by GAIN_SEL, of x and y, and of z.
static double step_ut(const struct emulated_mlx90393 *chip, int axis)
{
    static const double xy[8] = {0.751, 0.601, 0.451, 0.376, 0.300, 0.250, 0.200, 0.150};
    static const double z[8] = {1.210, 0.968, 0.726, 0.605, 0.484, 0.403, 0.323, 0.242};
    double step = (axis == 2 ? z : xy)[chip->words[0] >> 4 & 7];
    return (chip->words[0] & ~0x7F) == FACTORY ? step : step * 1.3;
}

// 16 of 19 bits, as RES picks them: with RES 0 and 1 what is beyond wraps around (section 16.2.6).
static uint16_t output(struct emulated_mlx90393 *chip, int axis, double gauss)
{
    static const uint16_t zero[4] = {0, 0, 0x8000, 0x4000};
    unsigned res = chip->words[2] >> (5 + 2 * axis) & 3;
    double counts = magnetometer_sensed(&chip->common, gauss) * 100.0 / step_ut(chip, axis);
    if (!chip->acknowledged)
        counts = 0.0; // "to get valid measurement data" the first status has to be read
    double clipped = fmax(-CONVERTER_END, fmin(CONVERTER_END, counts));
    return (uint16_t)((int)floor(clipped / (1 << res) + 0.5) + zero[res]);
}

static uint64_t convert(struct emulated_magnetometer *common)
{
    struct emulated_mlx90393 *chip = (struct emulated_mlx90393 *)common;
    uint16_t measured[4] = {(uint16_t)lround(46244 + 45.2 * (common->temperature_c - 25.0))};
    uint64_t axis_ns = magnetometer_stretched(common, slowed_ns(chip, axis_us(chip)));
    uint64_t after_ns = magnetometer_stretched(common, slowed_ns(chip, AFTER_Z_US));
    uint64_t begin_ns = common->now_ns - after_ns - axis_count(chip) * axis_ns;
    for (int axis = 0; axis < 3; axis++) { // the measured quantities are converted one after the other
        uint64_t end_ns = begin_ns + (chip->axes >> (axis + 1) & 1 ? axis_ns : 0);
        double gauss[3];
        magnetometer_mean(common, begin_ns, end_ns, gauss);
        measured[axis + 1] = output(chip, axis, gauss[axis]);
        begin_ns = end_ns;
    }
    for (int i = 0; i < 4; i++) {
        chip->sample[2 * i] = (uint8_t)(measured[i] >> 8);
        chip->sample[2 * i + 1] = (uint8_t)measured[i];
    }
    chip->has_sample = true;
    if (chip->mode == MODE_BURST)
        return conversion_ns(chip) + 20000000ULL * (chip->words[1] & 0x3F);
    chip->mode = 0;
    return 0;
}

static void answer(struct emulated_mlx90393 *chip, bool error, const uint8_t *bytes, uint8_t count)
{
    uint8_t words = count > 2 ? (uint8_t)(count / 2 - 1) : 0;
    chip->answer[0] = (uint8_t)(chip->mode | (error ? ERROR : 0) | (chip->was_reset ? RS : 0) | (words & 3));
    if (count)
        memcpy(chip->answer + 1, bytes, count);
    chip->answer_count = (uint8_t)(count + 1);
    chip->answer_sent = 0;
}

static void measure(struct emulated_mlx90393 *chip, uint8_t mode, uint8_t axes)
{
    unsigned osr = chip->words[2] & 3, filter = chip->words[2] >> 2 & 7;
    chip->mode = mode;
    chip->axes = axes ? axes : chip->words[1] >> 6 & 15;
    chip->has_sample = chip->was_reset = chip->exits = false;
    // Table 18: with this HALLCONF the fastest filters are not permitted; such a measurement never ends.
    if ((chip->words[0] & 15) == HALLCONF && ((osr == 0 && filter < 2) || (osr == 1 && filter == 0)))
        magnetometer_end(&chip->common);
    else
        magnetometer_begin(&chip->common, conversion_ns(chip));
}

static void obey(struct emulated_mlx90393 *chip)
{
    static const uint8_t nothing[8] = {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF};
    uint8_t command = chip->command[0] & 0xF0, axes = chip->command[0] & 0x0F;
    bool refused = false;
    chip->start_unread = command == START_BURST || command == START_SINGLE;
    if (command == RESET) {
        power_on(&chip->common.part);
    } else if (command == EXIT) {
        chip->was_reset = false;
        chip->exits = true;
        chip->exits_ns = chip->common.now_ns + (chip->mode ? EXIT_NS : 0);
    } else if (command == READ_MEASUREMENT) {
        refused = !chip->has_sample || axes != chip->axes; // each sample can be read only once
        answer(chip, refused, refused ? nothing : chip->sample, 8);
        chip->has_sample = chip->has_sample && refused;
        return;
    } else if (command == READ_REGISTER) {
        uint16_t word = chip->words[chip->command[1] >> 2];
        const uint8_t bytes[2] = {(uint8_t)(word >> 8), (uint8_t)word};
        answer(chip, chip->mode != 0, chip->mode ? nothing : bytes, 2); // no answer while the chip measures
        return;
    } else if (command == WRITE_REGISTER) {
        refused = chip->mode != 0;
        if (!refused && !chip->common.writes_lost)
            chip->words[chip->command[3] >> 2] = (uint16_t)(chip->command[1] << 8 | chip->command[2]);
    } else if (command == START_BURST || command == START_SINGLE) {
        measure(chip, command == START_BURST ? MODE_BURST : MODE_SINGLE, axes);
    } else {
        refused = command != 0;
    }
    answer(chip, refused, NULL, 0);
}

static void advance(struct emulated_part *part, uint64_t now_ns)
{
    struct emulated_mlx90393 *chip = (struct emulated_mlx90393 *)part;
    magnetometer_advance(part, now_ns);
    if (chip->exits && chip->exits_ns <= now_ns) {
        chip->exits = false;
        chip->mode = 0;
        magnetometer_end(&chip->common);
    }
}

static void start_write(struct emulated_part *part)
{
    ((struct emulated_mlx90393 *)part)->command_count = 0;
}

static void put(struct emulated_part *part, uint8_t byte)
{
    struct emulated_mlx90393 *chip = (struct emulated_mlx90393 *)part;
    if (chip->command_count == sizeof chip->command)
        return;
    chip->command[chip->command_count++] = byte;
    uint8_t first = chip->command[0] & 0xF0;
    uint8_t length = first == READ_REGISTER ? 2 : first == WRITE_REGISTER ? 4 : 1;
    if (chip->command_count == length)
        obey(chip);
}

static uint8_t get(struct emulated_part *part)
{
    struct emulated_mlx90393 *chip = (struct emulated_mlx90393 *)part;
    chip->acknowledged |= chip->start_unread;
    chip->start_unread = false;
    return chip->answer_sent < chip->answer_count ? chip->answer[chip->answer_sent++] : 0xFF;
}

void emulated_mlx90393_init(struct emulated_mlx90393 *chip, uint8_t address, uint32_t seed)
{
    static const struct emulated_part_kind kind = {power_on, advance, start_write, put, get};
    memset(chip, 0, sizeof *chip);
    chip->slowness = 1.0;
    magnetometer_init(&chip->common, &kind, address, convert, seed);
    chip->common.sensitivity_per_k = -3e-4;
}
