#include "sensor_poll.h"

static struct hmc5983_config config_of(const struct sensor_link *link)
{
    return (struct hmc5983_config){
        .gain_code = link->gain_code,
        .bias = HMC5983_BIAS_NONE,
        .mode = link->trigger == TRIGGER_FREE ? HMC5983_CONTINUOUS : HMC5983_IDLE,
    };
}

static enum bus_result identify(struct sensor *sensor, const struct sensor_link *link)
{
    enum bus_result result = hmc5983_identify(link->bus, sensor->identification);
    if (result != BUS_OK)
        return result;
    if (hmc5983_is_identification(sensor->identification))
        sensor->phase = PHASE_CONFIGURE;
    else
        sensor_fail(sensor, SENSOR_WRONG_IDENTIFICATION, clock_now(link->clock));
    return BUS_OK;
}

// Also reads all six output registers: their sample is old, and reading them undoes a LOCK.
static enum bus_result configure(struct sensor *sensor, const struct sensor_link *link)
{
    const struct hmc5983_config config = config_of(link);
    bool held = false;
    enum bus_result result = hmc5983_configure(link->bus, &config);
    if (result == BUS_OK)
        result = hmc5983_verify(link->bus, &config, &held);
    if (result == BUS_OK)
        result = hmc5983_read(link->bus, sensor->counts);
    if (result != BUS_OK)
        return result;
    uint64_t now_us = clock_now(link->clock);
    if (!held) {
        sensor_fail(sensor, SENSOR_CONFIG_NOT_HELD, now_us);
        return BUS_OK;
    }
    sensor->phase = PHASE_RUN;
    sensor->has_sample = sensor->fresh = sensor->awaiting = sensor->overtaken = false;
    sensor->discard_next = true;
    sensor->unchanged = 0;
    conversion_restart(&sensor->conversion, now_us);
    // The first measurement comes after two periods (data sheet, mode register) and still has the old gain.
    sensor->settled_us = now_us + HMC5983_PERIOD_US * 5 / 2;
    sensor_schedule(sensor, link, now_us);
    return BUS_OK;
}

static enum bus_result do_chore(struct sensor *sensor, const struct sensor_link *link)
{
    bool held = true;
    enum bus_result result;
    if (sensor->temperature_next) {
        result = hmc5983_read_temperature(link->bus, &sensor->temperature_raw);
    } else {
        const struct hmc5983_config config = config_of(link);
        result = hmc5983_verify(link->bus, &config, &held);
    }
    if (result != BUS_OK)
        return result;
    uint64_t now_us = clock_now(link->clock);
    sensor->temperature_next = !sensor->temperature_next;
    sensor->phase = PHASE_RUN;
    sensor_schedule(sensor, link, now_us);
    if (!held) {
        (*link->config_repairs)++;
        sensor_reconfigure(sensor, now_us);
    }
    return BUS_OK;
}

enum bus_result sensor_turn(struct sensor *sensor, const struct sensor_link *link)
{
    static enum bus_result (*const turns[])(struct sensor *, const struct sensor_link *) = {
        [PHASE_IDENTIFY] = identify,
        [PHASE_CONFIGURE] = configure,
        [PHASE_RUN] = sensor_poll,
        [PHASE_CHORE] = do_chore,
    };
    enum bus_result result = turns[sensor->phase](sensor, link);
    if (result == BUS_OK)
        sensor->strikes = 0;
    return result;
}
