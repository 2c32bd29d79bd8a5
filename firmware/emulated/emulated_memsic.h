// What the MMC5983MA and the MMC5603NJ share: a magnetised film, pulses that turn it, measurements that take time.
// emulated_memsic.c names the sources.
#ifndef FMFTS_EMULATED_MEMSIC_H
#define FMFTS_EMULATED_MEMSIC_H

#include "magnetometer.h"

// Bits of control 0 and control 1 of both.
enum { MEMSIC_TM_M = 0x01, MEMSIC_SET = 0x08, MEMSIC_RESET = 0x10, MEMSIC_AUTO_SR_EN = 0x20, MEMSIC_SW_RST = 0x80 };

struct emulated_memsic;

struct emulated_memsic_kind {
    uint8_t status, done, control_0; // registers, and the status bit that reports the end of a measurement
    int zero;                        // the count at zero field
    double counts_per_gauss, upsetting_gauss;
    uint32_t sample_ns[4]; // by bandwidth
    double noise_gauss[4];
    uint32_t between_pulses_ns; // extra time of an automatic set/reset, beyond its two samples
    uint32_t settles_ns;        // after a pulse
    uint32_t reset_ns;
    void (*restart)(struct emulated_memsic *chip);                    // registers as after a reset
    uint64_t (*period_ns)(struct emulated_memsic *chip);              // period of continuous measurements; 0: none
    int (*coil_current)(const struct emulated_memsic *chip);          // 1 or -1 with the self-test's current
    void (*show)(struct emulated_memsic *chip, const int counts[3]); // to the outputs
};

struct emulated_memsic {
    struct emulated_magnetometer common;
    const struct emulated_memsic_kind *kind;
    // A test may set these.
    double repeatability_gauss;           // the zero changes with each pulse by this standard deviation
    double zero_gauss[3], coil_gauss[3];  // what the bridges say of no field, and the coil's field, by the chip's axes
    bool done_stays_when_written;         // page 14 is ambiguous
    // The film. A part just after power-on may have either polarity; here it has that of RESET.
    int polarity; // 1 after SET, -1 after RESET
    bool upset, pulsed;
    uint64_t pulsed_ns;
    double pulse_zero_gauss[3];
    uint8_t controls[4];
    uint64_t starts_until_ns; // after a reset
    // The measurement that is running.
    uint32_t sample_ns;
    bool automatic, exactly; // with automatic set/reset; the command was 0x21 and nothing else
};

void emulated_memsic_init(struct emulated_memsic *chip, const struct emulated_memsic_kind *kind,
                          const struct emulated_part_kind *part, uint32_t seed);
void emulated_memsic_power_on(struct emulated_part *part);
void emulated_memsic_write(struct emulated_memsic *chip, uint8_t number, uint8_t value);
// Zero for controls, which cannot be read.
uint8_t emulated_memsic_read(const struct emulated_memsic *chip, uint8_t number);
// How long the measurement takes that begins now, by the data sheet.
uint64_t emulated_memsic_measurement_ns(struct emulated_memsic *chip);
bool emulated_memsic_hears(const struct emulated_memsic *chip);

#endif
