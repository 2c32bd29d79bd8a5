#include "sensor.h"

#include <string.h>

enum {
    STRIKES_MAX = 3,
    BACKOFF_FIRST_US = 50000,
    BACKOFF_DOUBLINGS = 4,
    STRIKE_PAUSE_US = 1000,
};

enum { STALE_PERIODS = 4, STALE_US = 18000 }; // a sample is used until it is older than both

void sensor_init(struct sensor *sensor, uint8_t address, uint64_t now_us, uint64_t first_chore_us)
{
    *sensor = (struct sensor){
        .address = address,
        .state = SENSOR_NOT_STARTED,
        .temperature_raw = WIRE_TEMPERATURE_UNKNOWN,
        .temperature_next = true,
        .due_us = now_us,
        .chore_us = (uint32_t)first_chore_us - SENSOR_CHORE_INTERVAL_US,
    };
}

const struct chip *sensor_chip(const struct sensor *sensor)
{
    return chip_places[sensor->place].chip;
}

struct chip_wires sensor_wires(const struct sensor *sensor, const struct sensor_link *link)
{
    return (struct chip_wires){link->bus, chip_places[sensor->place].address, sensor_chip(sensor)->memsic};
}

void sensor_fail(struct sensor *sensor, enum sensor_state state, uint64_t now_us)
{
    sensor->state = (uint8_t)state;
    sensor->phase = PHASE_IDENTIFY;
    sensor->has_sample = sensor->fresh = sensor->awaiting = false;
    sensor->strikes = sensor->missed = 0;
    sensor->doubts = 0;
    sensor->temperature_raw = WIRE_TEMPERATURE_UNKNOWN;
    sensor->due_us = now_us + ((uint64_t)BACKOFF_FIRST_US << sensor->failures);
    if (sensor->failures < BACKOFF_DOUBLINGS)
        sensor->failures++;
    if (state == SENSOR_NO_ANSWER)
        memset(sensor->identification, 0, sizeof sensor->identification);
}

void sensor_strike(struct sensor *sensor, uint64_t now_us)
{
    sensor->due_us = now_us + STRIKE_PAUSE_US;
    if (++sensor->strikes >= STRIKES_MAX)
        sensor_fail(sensor, SENSOR_NO_ANSWER, now_us);
}

void sensor_reconfigure(struct sensor *sensor, uint64_t now_us)
{
    sensor->has_sample = sensor->fresh = sensor->awaiting = false;
    if (!sensor_is_running(sensor))
        return;
    sensor->phase = PHASE_RESET;
    sensor->due_us = now_us;
}

void sensor_overtake(struct sensor *sensor, uint64_t triggered_us)
{
    sensor->overtaken = sensor->awaiting;
    sensor->triggered_us = triggered_us;
    if (sensor->overtaken)
        sensor->due_us = triggered_us;
}

void sensor_await(struct sensor *sensor, uint64_t triggered_us)
{
    sensor->awaiting = true;
    sensor->confirmed = sensor->overtaken = sensor->fresh = false;
    sensor->conversion.ended_us = triggered_us + sensor_chip(sensor)->trigger->conversion_us;
    sensor->due_us = triggered_us + sensor_chip(sensor)->trigger->wait_us;
}

void sensor_was_set(struct sensor *sensor, uint64_t now_us)
{
    sensor->film = FILM_UNDISTURBED;
    sensor->set_us = (uint32_t)now_us;
    sensor->settled_us = now_us + CHIP_SET_PAUSE_US + sensor_chip(sensor)->trigger->conversion_us;
}

bool sensor_is_identified(const struct sensor *sensor)
{
    return sensor->phase != PHASE_IDENTIFY;
}

bool sensor_is_running(const struct sensor *sensor)
{
    return sensor->phase == PHASE_RUN || sensor->phase == PHASE_CHORE;
}

bool sensor_streams(const struct sensor *sensor, enum trigger trigger)
{
    return trigger == TRIGGER_FREE && !sensor_chip(sensor)->paced;
}

uint64_t sensor_time_us(const struct sensor *sensor, enum trigger trigger)
{
    const struct chip *chip = sensor_chip(sensor);
    uint32_t measurement_us = chip->fills_period ? sensor->conversion.period_us : 0;
    if (!sensor_streams(sensor, trigger))
        measurement_us = chip->trigger->conversion_us;
    return sensor->conversion.ended_us - measurement_us / 2;
}

bool sensor_is_valid(const struct sensor *sensor, enum trigger trigger, uint64_t now_us)
{
    if (sensor->state != SENSOR_OK || !sensor->has_sample)
        return false;
    uint32_t stale_us = STALE_PERIODS * (uint32_t)sensor->conversion.nominal_us;
    stale_us = stale_us > STALE_US ? stale_us : STALE_US;
    return trigger == TRIGGER_SIMULTANEOUS ? sensor->fresh : now_us < sensor->conversion.ended_us + stale_us;
}
