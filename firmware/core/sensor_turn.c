#include "sensor_poll.h"

#include <string.h>

enum { DOUBT_US = 1500, DOUBTS_MAX = 2 };

// A gain code that the chip lacks belongs to another chip: the host will set one when it knows the board.
static struct chip_setup setup_of(const struct sensor *sensor, const struct sensor_link *link)
{
    uint8_t last = (uint8_t)(sensor_chip(sensor)->gain_codes - 1);
    return (struct chip_setup){
        .speed = chip_speed_for(sensor_chip(sensor), link->rate_hz),
        .gain_code = link->gain_code < last ? link->gain_code : last,
        .streams = sensor_streams(sensor, link->trigger),
    };
}

// Asks at every place where a chip may be. A chip that answers wrongly is asked again before it counts as another chip:
// it may have been busy, or the bus noisy. A kind that is recognised by writing comes last. If something has answered,
// it waits for the second attempt: the answer may come from another kind that was misread, and the write would change
// its registers.
static enum bus_result identify(struct sensor *sensor, const struct sensor_link *link)
{
    bool answered = false;
    for (sensor->place = 0; sensor->place < CHIP_PLACES; sensor->place++) {
        if (answered && sensor_chip(sensor)->asked_by_writing && !sensor->doubts)
            break;
        if (sensor->address != SENSOR_ANY_ADDRESS && sensor->address != chip_places[sensor->place].address)
            continue;
        const struct chip_wires wires = sensor_wires(sensor, link);
        uint8_t identification[3];
        enum bus_result result = sensor_chip(sensor)->identify(&wires, identification);
        if (result != BUS_OK && result != BUS_NO_ANSWER)
            return result;
        bool known = result == BUS_OK && sensor_chip(sensor)->is_identification(identification);
        if (result == BUS_OK && (known || !answered))
            memcpy(sensor->identification, identification, sizeof sensor->identification);
        if (known) {
            sensor->phase = PHASE_RESET;
            sensor->doubts = 0;
            return BUS_OK;
        }
        answered |= result == BUS_OK;
    }
    sensor->place = 0;
    if (!answered)
        return BUS_NO_ANSWER;
    uint64_t now_us = clock_now(link->clock);
    sensor->due_us = now_us + DOUBT_US;
    if (++sensor->doubts > DOUBTS_MAX)
        sensor_fail(sensor, SENSOR_WRONG_IDENTIFICATION, now_us);
    return BUS_OK;
}

// Also reads the outputs: their sample is old, and reading them undoes a LOCK.
static enum bus_result configure(struct sensor *sensor, const struct sensor_link *link)
{
    const struct chip *chip = sensor_chip(sensor);
    const struct chip_wires wires = sensor_wires(sensor, link);
    const struct chip_setup setup = setup_of(sensor, link);
    bool held = false;
    enum bus_result result = chip->set_up(&wires, &setup);
    if (result == BUS_OK)
        result = chip->check(&wires, &setup, &held);
    if (result == BUS_OK && chip->read_counts)
        result = chip->read_counts(&wires, sensor->counts);
    if (result != BUS_OK)
        return result;
    uint64_t now_us = clock_now(link->clock);
    if (!held || !(setup.streams || chip->trigger)) {
        sensor_fail(sensor, SENSOR_CONFIG_NOT_HELD, now_us);
        return BUS_OK;
    }
    uint16_t period_us = chip->speeds[setup.speed].period_us;
    sensor->phase = PHASE_RUN;
    sensor->has_sample = sensor->fresh = sensor->awaiting = sensor->overtaken = false;
    sensor->discard_next = true;
    sensor->unchanged = 0;
    conversion_restart(&sensor->conversion, period_us, now_us);
    // The HMC5983's first measurement comes after two periods (data sheet, mode register) and still has the old gain.
    sensor->settled_us = now_us + period_us * 5U / 2U;
    if (chip->set)
        sensor_was_set(sensor, now_us);
    sensor_schedule(sensor, link, now_us);
    return BUS_OK;
}

static enum bus_result reset(struct sensor *sensor, const struct sensor_link *link)
{
    const struct chip *chip = sensor_chip(sensor);
    if (!chip->reset) {
        sensor->phase = PHASE_CONFIGURE;
        return configure(sensor, link);
    }
    const struct chip_wires wires = sensor_wires(sensor, link);
    enum bus_result result = chip->reset(&wires);
    if (result == BUS_OK) {
        sensor->phase = PHASE_CONFIGURE;
        sensor->due_us = clock_now(link->clock) + chip->reset_us;
    }
    return result;
}

static enum bus_result do_chore(struct sensor *sensor, const struct sensor_link *link)
{
    bool held = true;
    enum bus_result result;
    const struct chip *chip = sensor_chip(sensor);
    const struct chip_wires wires = sensor_wires(sensor, link);
    if (sensor->temperature_next && chip->read_thermometer) {
        result = chip->read_thermometer(&wires, &sensor->temperature_raw);
    } else {
        const struct chip_setup setup = setup_of(sensor, link);
        result = chip->check(&wires, &setup, &held);
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
        [PHASE_RESET] = reset,
        [PHASE_CONFIGURE] = configure,
        [PHASE_RUN] = sensor_poll,
        [PHASE_CHORE] = do_chore,
    };
    enum bus_result result = turns[sensor->phase](sensor, link);
    if (result == BUS_OK)
        sensor->strikes = 0;
    return result;
}
