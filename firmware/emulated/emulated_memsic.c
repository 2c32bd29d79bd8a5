// S: MEMSIC MMC5983MA data sheet, Rev A (read). D: independent drivers agree. U: users measured it.
// Film: S p. 18 (after SET the output is +H + offset, after RESET -H + offset), S p. 2 (a field above 10 G changes it until
// the next pulse; SET/RESET repeats to 1 mG), S p. 9 (left-handed after SET: z points into the board), D the maker's sample
// code in DRNadler/MMC5983MA_CompassTest and ArduPilot AP_Compass_MMC5xx3 (0.5 to 1 ms between a pulse and a measurement).
// Automatic set/reset: U DRNadler/MMC5983MA_CompassTest (SET, sample, RESET, sample, half the difference; twice the time
// and about 1 ms), U SlimeVR-Tracker-nRF issue 150, S p. 2 (at most 50/100/225/580 Hz).
// Unverified, and chosen here: a new TM_M restarts a measurement that runs; how wrong a measurement is soon after a pulse,
// with an upset film or in the strong field itself; that writing 1 to Meas_M_Done clears the bit and not only its interrupt.
#include "emulated_memsic.h"

#include <math.h>
#include <string.h>

static const double REMANENCE_GAUSS = 0.3, UPSET_SENSITIVITY = 0.5; // of an upset film, after the strong field is gone
static const double UNSETTLED_GAUSS = 0.2; // the error of a measurement that begins right at a pulse

static bool is_strong(const struct emulated_memsic *chip, const double gauss[3])
{
    return sqrt(gauss[0] * gauss[0] + gauss[1] * gauss[1] + gauss[2] * gauss[2]) > chip->kind->upsetting_gauss;
}

static void exposed(struct emulated_magnetometer *common, const double gauss[3])
{
    struct emulated_memsic *chip = (struct emulated_memsic *)common;
    chip->upset |= is_strong(chip, gauss);
}

static void pulse(struct emulated_memsic *chip, int polarity, uint64_t ns)
{
    chip->polarity = polarity;
    chip->upset = false;
    chip->pulsed = true;
    chip->pulsed_ns = ns;
    for (int axis = 0; axis < 3; axis++)
        chip->pulse_zero_gauss[axis] = chip->repeatability_gauss * magnetometer_normal(&chip->common);
}

// A pulse in the middle of a measurement spoils it as much as one at its beginning.
static double unsettled_gauss(const struct emulated_memsic *chip, uint64_t begin_ns)
{
    double age_ns = begin_ns > chip->pulsed_ns ? (double)(begin_ns - chip->pulsed_ns) : 0.0;
    return chip->pulsed ? UNSETTLED_GAUSS * fmax(0.0, 1.0 - age_ns / chip->kind->settles_ns) : 0.0;
}

// Counts from the middle of the range at this time.
static void sample(struct emulated_memsic *chip, uint64_t begin_ns, uint64_t end_ns, double counts[3])
{
    double gauss[3], error = chip->automatic ? 0.0 : unsettled_gauss(chip, begin_ns);
    magnetometer_mean(&chip->common, begin_ns, end_ns, gauss);
    exposed(&chip->common, gauss);
    double sensitivity = chip->upset && !is_strong(chip, gauss) ? UPSET_SENSITIVITY : 1.0;
    for (int axis = 0; axis < 3; axis++) {
        double felt = magnetometer_sensed(&chip->common, axis == 2 ? -gauss[axis] : gauss[axis]);
        felt += chip->kind->coil_current(chip) * chip->coil_gauss[axis];
        double shown = chip->polarity * felt * sensitivity;
        shown += chip->zero_gauss[axis] + chip->pulse_zero_gauss[axis] + (chip->upset ? REMANENCE_GAUSS : 0.0) + error;
        counts[axis] = fmax(-chip->kind->zero, fmin(chip->kind->zero - 1, shown * chip->kind->counts_per_gauss));
    }
}

static uint64_t convert(struct emulated_magnetometer *common)
{
    struct emulated_memsic *chip = (struct emulated_memsic *)common;
    uint64_t end_ns = common->now_ns, sample_ns = magnetometer_stretched(common, chip->sample_ns);
    double first[3], second[3] = {0, 0, 0};
    int counts[3];
    if (chip->automatic) {
        uint64_t pause_ns = magnetometer_stretched(common, chip->kind->between_pulses_ns / 2);
        uint64_t turns_ns = end_ns - sample_ns - pause_ns;
        pulse(chip, 1, turns_ns - sample_ns - pause_ns);
        sample(chip, turns_ns - sample_ns, turns_ns, first);
        pulse(chip, -1, turns_ns);
        sample(chip, end_ns - sample_ns, end_ns, second);
    } else {
        sample(chip, end_ns - sample_ns, end_ns, first);
    }
    for (int axis = 0; axis < 3; axis++) {
        double value = chip->automatic ? (first[axis] - second[axis]) / 2 : first[axis];
        counts[axis] = chip->kind->zero + magnetometer_count(value, -chip->kind->zero, chip->kind->zero - 1);
    }
    chip->kind->show(chip, counts);
    common->registers[chip->kind->status] |= chip->kind->done;
    return chip->kind->period_ns(chip);
}

uint64_t emulated_memsic_measurement_ns(struct emulated_memsic *chip)
{
    chip->sample_ns = chip->kind->sample_ns[chip->controls[1] & 3];
    chip->automatic = chip->controls[0] & MEMSIC_AUTO_SR_EN;
    return chip->automatic ? 2ULL * chip->sample_ns + chip->kind->between_pulses_ns : chip->sample_ns;
}

static void command(struct emulated_memsic *chip, uint8_t value)
{
    struct emulated_magnetometer *common = &chip->common;
    chip->controls[0] = value & (uint8_t)~(MEMSIC_TM_M | MEMSIC_SET | MEMSIC_RESET); // these clear themselves
    if (value & (MEMSIC_SET | MEMSIC_RESET))
        pulse(chip, value & MEMSIC_SET ? 1 : -1, common->now_ns);
    if (value & MEMSIC_TM_M) {
        common->registers[chip->kind->status] &= (uint8_t)~chip->kind->done;
        chip->exactly = value == (MEMSIC_TM_M | MEMSIC_AUTO_SR_EN);
        magnetometer_begin(common, emulated_memsic_measurement_ns(chip));
    }
}

bool emulated_memsic_hears(const struct emulated_memsic *chip)
{
    return chip->common.now_ns >= chip->starts_until_ns && !chip->common.writes_lost;
}

void emulated_memsic_write(struct emulated_memsic *chip, uint8_t number, uint8_t value)
{
    struct emulated_magnetometer *common = &chip->common;
    int control = number - chip->kind->control_0;
    if (!emulated_memsic_hears(chip))
        return;
    if (number == chip->kind->status && !chip->done_stays_when_written) {
        common->registers[number] &= (uint8_t)~(value & chip->kind->done);
    } else if (control == 1 && (value & MEMSIC_SW_RST)) {
        emulated_memsic_power_on(&common->part);
        chip->starts_until_ns = common->now_ns + chip->kind->reset_ns;
    } else if (control == 0) {
        command(chip, value);
    } else if (control > 0 && control < (int)sizeof chip->controls) {
        chip->controls[control] = value;
        if (control == 2) {
            magnetometer_end(common);
            uint64_t period_ns = chip->kind->period_ns(chip);
            if (period_ns)
                magnetometer_begin(common, period_ns);
        }
    }
}

uint8_t emulated_memsic_read(const struct emulated_memsic *chip, uint8_t number)
{
    int control = number - chip->kind->control_0;
    return control >= 0 && control < (int)sizeof chip->controls ? 0 : chip->common.registers[number];
}

static double own_noise_gauss(const struct emulated_magnetometer *common)
{
    const struct emulated_memsic *chip = (const struct emulated_memsic *)common;
    return chip->kind->noise_gauss[chip->controls[1] & 3];
}

// Registers start anew. The film stays as it is: no pulse is among these.
void emulated_memsic_power_on(struct emulated_part *part)
{
    struct emulated_memsic *chip = (struct emulated_memsic *)part;
    magnetometer_clear(&chip->common);
    memset(chip->controls, 0, sizeof chip->controls);
    chip->starts_until_ns = 0;
    chip->exactly = false;
    chip->kind->restart(chip);
}

void emulated_memsic_init(struct emulated_memsic *chip, const struct emulated_memsic_kind *kind,
                          const struct emulated_part_kind *part, uint32_t seed)
{
    memset(chip, 0, sizeof *chip);
    chip->kind = kind;
    chip->polarity = -1;
    chip->repeatability_gauss = 1e-3;
    for (int axis = 0; axis < 3; axis++)
        chip->coil_gauss[axis] = 0.125;
    magnetometer_init(&chip->common, part, 0x30, convert, seed);
    chip->common.own_noise_gauss = own_noise_gauss;
    chip->common.exposed = exposed;
    chip->common.sensitivity_per_k = -2e-4;
}
