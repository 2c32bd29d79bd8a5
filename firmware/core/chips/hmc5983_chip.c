// The HMC5983 and HMC5883L among the chips: hmc5983.c has their registers.
#include "../hmc5983.h"
#include "chip.h"

static struct hmc5983_config config_of(const struct chip_setup *setup)
{
    return (struct hmc5983_config){
        .gain_code = setup->gain_code,
        .bias = HMC5983_BIAS_NONE,
        .mode = setup->streams ? HMC5983_CONTINUOUS : HMC5983_IDLE,
    };
}

static enum bus_result hmc5983_set_up(const struct bus *bus, const struct chip_setup *setup)
{
    const struct hmc5983_config config = config_of(setup);
    return hmc5983_configure(bus, &config);
}

static enum bus_result hmc5983_check(const struct bus *bus, const struct chip_setup *setup, bool *held)
{
    const struct hmc5983_config config = config_of(setup);
    return hmc5983_verify(bus, &config, held);
}

const struct chip chip_hmc5983 = {
    .address = HMC5983_ADDRESS,
    .gain_codes = HMC5983_GAIN_CODES,
    .has_trigger = true,
    .rate_hz = HMC5983_RATE_HZ,
    .period_us = HMC5983_PERIOD_US,
    .identify = hmc5983_identify,
    .is_identification = hmc5983_is_identification,
    .set_up = hmc5983_set_up,
    .check = hmc5983_check,
    .read_status = hmc5983_read_status,
    .read_counts = hmc5983_read,
    .read_thermometer = hmc5983_read_temperature,
};
