// The HMC5983 three-axis magnetometer (Honeywell data sheet 900425). Every function is one or two short transfers.
#ifndef FMFTS_HMC5983_H
#define FMFTS_HMC5983_H

#include <stdbool.h>
#include <stdint.h>

#include "bus.h"
#include "wire.h"

enum {
    HMC5983_ADDRESS = 0x1E,
    HMC5983_OVERFLOW = -4096,
    HMC5983_GAIN_CODES = 8,
    HMC5983_SELFTEST_GAIN = 5,
    HMC5983_RATE_HZ = 220,               // the highest rate that a chip reaches by its own clock
    HMC5983_PERIOD_US = 4545,            // at that rate
    HMC5983_SINGLE_CONVERSION_US = 6000, // data sheet: one measurement, average of one
    HMC5983_SINGLE_WAIT_US = 6200,       // the same for the slowest chip (clock tolerance 3 %), rounded up
    HMC5983_SINGLE_FASTEST_US = 5800,    // time of the fastest chip, rounded down
    HMC5983_SINGLE_RATE_MAX_HZ = 152,    // of simultaneous triggers: chips/hmc5983_chip.c
};

enum hmc5983_register {
    HMC5983_CONFIG_A = 0x00,
    HMC5983_CONFIG_B = 0x01,
    HMC5983_MODE = 0x02,
    HMC5983_DATA = 0x03, // X, Z, Y; big-endian
    HMC5983_STATUS = 0x09,
    HMC5983_IDENTIFICATION = 0x0A,
    HMC5983_TEMPERATURE = 0x31,
};

enum hmc5983_config_a {
    HMC5983_TEMPERATURE_COMPENSATION = 0x80, // off at power-on
    HMC5983_RATE_220_HZ = 7 << 2,
    HMC5983_BIAS_NONE = 0,
    HMC5983_BIAS_POSITIVE = 1,
    HMC5983_BIAS_NEGATIVE = 2,
};

enum hmc5983_mode { HMC5983_CONTINUOUS = 0, HMC5983_SINGLE = 1, HMC5983_IDLE = 2 };

enum hmc5983_status { HMC5983_READY = 1, HMC5983_LOCKED = 2 };

extern const uint16_t hmc5983_lsb_per_gauss[HMC5983_GAIN_CODES];

struct hmc5983_config {
    uint8_t gain_code;
    uint8_t bias;
    uint8_t mode;
};

enum bus_result hmc5983_identify(const struct bus *bus, uint8_t identification[3]);
bool hmc5983_is_identification(const uint8_t identification[3]);

// Writes gain, rate, temperature compensation, bias and mode. The sample after a gain change still has the old gain.
enum bus_result hmc5983_configure(const struct bus *bus, const struct hmc5983_config *config);

// Reads gain, rate, compensation and bias back. Not the mode: reading that register sets LOCK.
enum bus_result hmc5983_verify(const struct bus *bus, const struct hmc5983_config *config, bool *held);

// Starts one measurement on every sensor whose mux channel is on.
enum bus_result hmc5983_trigger(const struct bus *bus);

enum bus_result hmc5983_read_status(const struct bus *bus, uint8_t *status);

// x, y, z counts in one burst: anything less sets LOCK. HMC5983_OVERFLOW marks a saturated axis.
enum bus_result hmc5983_read(const struct bus *bus, int16_t counts[3]);

// 25 °C + raw/128.
enum bus_result hmc5983_read_temperature(const struct bus *bus, int16_t *raw);

// Judges the bias-strap measurement; all counts are at HMC5983_SELFTEST_GAIN. Fills state and the counts of `result`.
void hmc5983_judge_selftest(const int16_t unbiased[3], const int16_t positive[3], const int16_t negative[3],
                            struct wire_selftest_sensor *result);

#endif
