// An HMC5983 as its data sheet describes it, strict enough that a wrong driver reads wrong numbers.
// chip.c names the sources.
#ifndef FMFTS_EMULATED_CHIP_H
#define FMFTS_EMULATED_CHIP_H

#include "part.h"

struct emulated_chip {
    struct emulated_part part;
    // A test may set these at any time. Call emulated_chip_advance before, so that past conversions keep the old
    // values.
    double field_ut[3];
    double noise_ut;
    double temperature_c;
    double strap_gauss[3]; // field of the offset strap at full bias current
    double gain_error[3];  // relative, per axis
    double ppm;            // how much faster than nominal the chip's clock runs
    uint8_t saturated_axes; // bit i: a strong magnet sits on axis i
    bool clock_stopped;
    // emulated_chip_glide moves the field from field_ut at `glided_ns` to this field at `glide_until_ns`.
    double glide_ut[3];
    uint64_t glided_ns, glide_until_ns;
    bool config_read_only;       // configuration writes are lost
    bool ready_survives_reading; // only the next conversion clears READY; the data sheet is ambiguous
    bool strap_leaves_external;  // biased measurements keep the external field
    char identification[3];

    uint8_t config_a, config_b, mode;
    uint8_t data[6];
    int16_t temperature_raw;
    bool ready, overwritten;
    bool mode_was_read;
    uint8_t bytes_read; // bit i: data byte i was read since the registers were unlocked
    bool old_gain_pending;
    uint8_t old_gain_code;
    uint8_t pointer;
    bool pointer_expected;
    uint64_t next_conversion_ns;
    uint64_t now_ns;
    uint64_t conversions;
    uint64_t last_conversion_ns;
    uint32_t random;
};

void emulated_chip_init(struct emulated_chip *chip, uint32_t seed);
void emulated_chip_power_on(struct emulated_chip *chip);
void emulated_chip_advance(struct emulated_chip *chip, uint64_t now_ns);

// Changes the field evenly from its present value to `target_ut`, reaches it after `duration_ns`, and keeps it.
void emulated_chip_glide(struct emulated_chip *chip, const double target_ut[3], uint64_t duration_ns);

#endif
