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

static enum bus_result hmc5983_chip_identify(const struct chip_wires *wires, uint8_t identification[3])
{
    return hmc5983_identify(wires->bus, identification);
}

static enum bus_result hmc5983_chip_set_up(const struct chip_wires *wires, const struct chip_setup *setup)
{
    const struct hmc5983_config config = config_of(setup);
    return hmc5983_configure(wires->bus, &config);
}

static enum bus_result hmc5983_chip_check(const struct chip_wires *wires, const struct chip_setup *setup, bool *held)
{
    const struct hmc5983_config config = config_of(setup);
    return hmc5983_verify(wires->bus, &config, held);
}

// Its bits READY and LOCKED are those of `chip_status`.
static enum bus_result hmc5983_chip_read_status(const struct chip_wires *wires, struct chip_sample *sample)
{
    return hmc5983_read_status(wires->bus, &sample->status);
}

static enum bus_result hmc5983_chip_read_counts(const struct chip_wires *wires, int16_t counts[3])
{
    return hmc5983_read(wires->bus, counts);
}

static enum bus_result hmc5983_chip_read_thermometer(const struct chip_wires *wires, int16_t *raw)
{
    return hmc5983_read_temperature(wires->bus, raw);
}

static const struct chip_speed speeds[] = {{HMC5983_RATE_HZ, HMC5983_PERIOD_US}};

// At the highest rate one frame takes 6.47 ms: 6.2 ms of conversion, then one sensor's status and the trigger (107 bits
// with the mux selects). The rest is for the processor.
static const struct chip_trigger trigger = {
    .bytes = {HMC5983_MODE, HMC5983_SINGLE},
    .count = 2,
    .conversion_us = HMC5983_SINGLE_CONVERSION_US,
    .wait_us = HMC5983_SINGLE_WAIT_US,
    .fastest_us = HMC5983_SINGLE_FASTEST_US,
    .rate_max_hz = HMC5983_SINGLE_RATE_MAX_HZ,
};

const struct chip chip_hmc5983 = {
    .gain_codes = HMC5983_GAIN_CODES,
    .speed_count = 1,
    .ready_unsure = true,
    .has_strap = true,
    .speeds = speeds,
    .trigger = &trigger,
    .identify = hmc5983_chip_identify,
    .is_identification = hmc5983_is_identification,
    .set_up = hmc5983_chip_set_up,
    .check = hmc5983_chip_check,
    .read_status = hmc5983_chip_read_status,
    .read_counts = hmc5983_chip_read_counts,
    .read_thermometer = hmc5983_chip_read_thermometer,
};
