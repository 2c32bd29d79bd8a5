// What the emulated chips beside the HMC5983 share: the field, a clock of their own, registers behind a pointer.
#ifndef FMFTS_EMULATED_MAGNETOMETER_H
#define FMFTS_EMULATED_MAGNETOMETER_H

#include "part.h"

struct emulated_magnetometer {
    struct emulated_part part;
    // A test may set these at any time. Call magnetometer_advance before, so that past conversions keep the old values.
    double field_gauss[3];
    // The field at an instant of the bench, instead of field_gauss. A chip averages over its measurement if its file
    // knows when that begins; otherwise it takes the field at its end.
    void (*field_at)(const struct emulated_magnetometer *chip, uint64_t ns, double gauss[3]);
    double noise_gauss;
    bool has_own_noise; // own_noise_gauss of the present settings, instead of noise_gauss
    double temperature_c;
    double sensitivity_per_k; // relative change per degree from 25 degrees
    double ppm; // how much faster than nominal the chip's clock runs
    bool clock_stopped;
    bool writes_lost;
    // The end of a conversion. Returns the time to the next conversion according to the data sheet, 0 if it was the
    // last.
    uint64_t (*convert)(struct emulated_magnetometer *chip);
    double (*own_noise_gauss)(const struct emulated_magnetometer *chip); // one deviation; NULL: no source states it
    // NULL, or called with the field whenever time passes, also while nothing is measured.
    void (*exposed)(struct emulated_magnetometer *chip, const double gauss[3]);
    uint8_t registers[256];
    uint8_t pointer;
    bool pointer_expected;
    uint64_t now_ns, next_conversion_ns, last_conversion_ns;
    uint64_t conversions;
    uint32_t random;
};

void magnetometer_init(struct emulated_magnetometer *chip, const struct emulated_part_kind *kind, uint8_t address,
                       uint64_t (*convert)(struct emulated_magnetometer *chip), uint32_t seed);
void magnetometer_advance(struct emulated_part *part, uint64_t now_ns);

// Clears the registers; no conversion is running.
void magnetometer_clear(struct emulated_magnetometer *chip);
void magnetometer_begin(struct emulated_magnetometer *chip, uint64_t nominal_ns);
void magnetometer_end(struct emulated_magnetometer *chip);

// A time of the data sheet on this chip's clock.
uint64_t magnetometer_stretched(const struct emulated_magnetometer *chip, uint64_t nominal_ns);

// The mean field of a time, from five instants.
void magnetometer_mean(const struct emulated_magnetometer *chip, uint64_t begin_ns, uint64_t end_ns, double gauss[3]);
// What the chip reads in this field, with noise and temperature.
double magnetometer_sensed(struct emulated_magnetometer *chip, double gauss);
// The present field along one axis, as sensed.
double magnetometer_gauss(struct emulated_magnetometer *chip, int axis);
// A random number with a deviation of 1.
double magnetometer_normal(struct emulated_magnetometer *chip);
// The nearest count within these limits.
int magnetometer_count(double counts, int least, int most);

// For kinds whose first written byte is a register's number: true if `byte` was one.
bool magnetometer_takes_pointer(struct emulated_magnetometer *chip, uint8_t byte);
void magnetometer_start_write(struct emulated_part *part);

#endif
