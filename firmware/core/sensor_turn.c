#include "sensor_poll.h"

// A gain code that the chip has not is another chip's: the host will set one when it knows the board.
static struct chip_setup setup_of(const struct sensor *sensor, const struct sensor_link *link)
{
    uint8_t last = (uint8_t)(sensor_chip(sensor)->gain_codes - 1);
    return (struct chip_setup){
        .gain_code = link->gain_code < last ? link->gain_code : last,
        .streams = link->trigger == TRIGGER_FREE,
    };
}

static enum bus_result identify(struct sensor *sensor, const struct sensor_link *link)
{
    enum bus_result result = sensor_chip(sensor)->identify(link->bus, sensor->identification);
    if (result != BUS_OK)
        return result;
    if (sensor_chip(sensor)->is_identification(sensor->identification))
        sensor->phase = PHASE_CONFIGURE;
    else
        sensor_fail(sensor, SENSOR_WRONG_IDENTIFICATION, clock_now(link->clock));
    return BUS_OK;
}

// Also reads all six output registers: their sample is old, and reading them undoes a LOCK.
static enum bus_result configure(struct sensor *sensor, const struct sensor_link *link)
{
    const struct chip *chip = sensor_chip(sensor);
    const struct chip_setup setup = setup_of(sensor, link);
    bool held = false;
    enum bus_result result = chip->set_up(link->bus, &setup);
    if (result == BUS_OK)
        result = chip->check(link->bus, &setup, &held);
    if (result == BUS_OK)
        result = chip->read_counts(link->bus, sensor->counts);
    if (result != BUS_OK)
        return result;
    uint64_t now_us = clock_now(link->clock);
    if (!held || !(setup.streams || chip->has_trigger)) {
        sensor_fail(sensor, SENSOR_CONFIG_NOT_HELD, now_us);
        return BUS_OK;
    }
    sensor->phase = PHASE_RUN;
    sensor->has_sample = sensor->fresh = sensor->awaiting = sensor->overtaken = false;
    sensor->discard_next = true;
    sensor->unchanged = 0;
    conversion_restart(&sensor->conversion, chip->period_us, now_us);
    // The first measurement comes after two periods (data sheet, mode register) and still has the old gain.
    sensor->settled_us = now_us + chip->period_us * 5U / 2U;
    sensor_schedule(sensor, link, now_us);
    return BUS_OK;
}

static enum bus_result do_chore(struct sensor *sensor, const struct sensor_link *link)
{
    bool held = true;
    enum bus_result result;
    const struct chip *chip = sensor_chip(sensor);
    if (sensor->temperature_next && chip->read_thermometer) {
        result = chip->read_thermometer(link->bus, &sensor->temperature_raw);
    } else {
        const struct chip_setup setup = setup_of(sensor, link);
        result = chip->check(link->bus, &setup, &held);
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
