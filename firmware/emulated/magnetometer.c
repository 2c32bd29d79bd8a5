#include "magnetometer.h"

#include <math.h>
#include <string.h>

static const uint64_t NEVER = UINT64_MAX;

void magnetometer_init(struct emulated_magnetometer *chip, const struct emulated_part_kind *kind, uint8_t address,
                       uint64_t (*convert)(struct emulated_magnetometer *chip), uint32_t seed)
{
    memset(chip, 0, sizeof *chip);
    chip->part = (struct emulated_part){.kind = kind, .address = address, .present = true};
    chip->temperature_c = 25.0;
    chip->convert = convert;
    chip->random = seed * 2654435761U + 1U;
    kind->power_on(&chip->part);
}

void magnetometer_clear(struct emulated_magnetometer *chip)
{
    memset(chip->registers, 0, sizeof chip->registers);
    chip->pointer = 0;
    chip->pointer_expected = false;
    chip->next_conversion_ns = NEVER;
}

uint64_t magnetometer_stretched(const struct emulated_magnetometer *chip, uint64_t nominal_ns)
{
    return (uint64_t)((double)nominal_ns / (1.0 + chip->ppm * 1e-6));
}

void magnetometer_begin(struct emulated_magnetometer *chip, uint64_t nominal_ns)
{
    chip->next_conversion_ns = chip->now_ns + magnetometer_stretched(chip, nominal_ns);
}

void magnetometer_end(struct emulated_magnetometer *chip)
{
    chip->next_conversion_ns = NEVER;
}

void magnetometer_advance(struct emulated_part *part, uint64_t now_ns)
{
    struct emulated_magnetometer *chip = (struct emulated_magnetometer *)part;
    while (chip->next_conversion_ns <= now_ns && !chip->clock_stopped) {
        uint64_t ended_ns = chip->next_conversion_ns;
        chip->now_ns = chip->last_conversion_ns = ended_ns;
        chip->conversions++;
        uint64_t following_ns = chip->convert(chip);
        chip->next_conversion_ns = following_ns ? ended_ns + magnetometer_stretched(chip, following_ns) : NEVER;
    }
    if (chip->clock_stopped && chip->next_conversion_ns <= now_ns)
        chip->next_conversion_ns = now_ns + 1; // the conversion continues when the clock does
    chip->now_ns = now_ns;
    if (chip->exposed) {
        double gauss[3];
        magnetometer_mean(chip, now_ns, now_ns, gauss);
        chip->exposed(chip, gauss);
    }
}

void magnetometer_mean(const struct emulated_magnetometer *chip, uint64_t begin_ns, uint64_t end_ns, double gauss[3])
{
    enum { INSTANTS = 5 };
    if (!chip->field_at) {
        memcpy(gauss, chip->field_gauss, sizeof chip->field_gauss);
        return;
    }
    gauss[0] = gauss[1] = gauss[2] = 0.0;
    for (unsigned i = 0; i < INSTANTS; i++) {
        double then[3];
        chip->field_at(chip, begin_ns + (end_ns - begin_ns) * (2 * i + 1) / (2 * INSTANTS), then);
        for (int axis = 0; axis < 3; axis++)
            gauss[axis] += then[axis] / INSTANTS;
    }
}

static double uniform(struct emulated_magnetometer *chip)
{
    chip->random ^= chip->random << 13;
    chip->random ^= chip->random >> 17;
    chip->random ^= chip->random << 5;
    return chip->random / 4294967296.0;
}

double magnetometer_normal(struct emulated_magnetometer *chip)
{
    double normal = -6.0; // twelve uniform numbers add up to a variance of one
    for (int i = 0; i < 12; i++)
        normal += uniform(chip);
    return normal;
}

double magnetometer_sensed(struct emulated_magnetometer *chip, double gauss)
{
    double noise = chip->has_own_noise ? chip->own_noise_gauss(chip) : chip->noise_gauss;
    if (noise > 0.0)
        gauss += noise * magnetometer_normal(chip);
    return gauss * (1.0 + chip->sensitivity_per_k * (chip->temperature_c - 25.0));
}

double magnetometer_gauss(struct emulated_magnetometer *chip, int axis)
{
    double gauss[3];
    magnetometer_mean(chip, chip->now_ns, chip->now_ns, gauss);
    return magnetometer_sensed(chip, gauss[axis]);
}

int magnetometer_count(double counts, int least, int most)
{
    double nearest = round(counts);
    return nearest < least ? least : nearest > most ? most : (int)nearest;
}

void magnetometer_start_write(struct emulated_part *part)
{
    ((struct emulated_magnetometer *)part)->pointer_expected = true;
}

bool magnetometer_takes_pointer(struct emulated_magnetometer *chip, uint8_t byte)
{
    if (!chip->pointer_expected)
        return false;
    chip->pointer = byte;
    chip->pointer_expected = false;
    return true;
}
