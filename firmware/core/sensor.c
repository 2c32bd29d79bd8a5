#include "sensor.h"

#include <string.h>

enum {
    STRIKES_MAX = 3,
    MISSED_MAX = 3,
    UNCHANGED_MAX = 20,
    BACKOFF_FIRST_US = 50000,
    BACKOFF_DOUBLINGS = 4,
    STRIKE_PAUSE_US = 1000,
    POLL_PAUSE_US = 100,
    SILENCE_US = 50000,        // eleven conversions
    STALE_US = 4 * CONVERSION_PERIOD_US,
    LATE_CONVERSION_US = 3000, // beyond SINGLE_WAIT_US
    BURST_US = 250,            // six bytes, with some time to spare
    CHORE_INTERVAL_US = 125000,
    READY_SURVIVES = 3, // probes in a row
};

static const uint64_t NEVER = UINT64_MAX;

void sensor_init(struct sensor *sensor, uint64_t now_us, uint64_t first_chore_us)
{
    *sensor = (struct sensor){
        .state = SENSOR_NOT_STARTED,
        .temperature_raw = WIRE_TEMPERATURE_UNKNOWN,
        .temperature_next = true,
        .conversion.period_us = CONVERSION_PERIOD_US,
        .due_us = now_us,
        .chore_us = first_chore_us,
    };
}

void sensor_fail(struct sensor *sensor, enum sensor_state state, uint64_t now_us)
{
    sensor->state = (uint8_t)state;
    sensor->phase = PHASE_IDENTIFY;
    sensor->has_sample = sensor->fresh = sensor->awaiting = false;
    sensor->strikes = sensor->missed = 0;
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
    sensor->phase = PHASE_CONFIGURE;
    sensor->due_us = now_us;
}

void sensor_overtake(struct sensor *sensor, uint64_t triggered_us)
{
    sensor->overtaken = sensor->awaiting;
    sensor->overtaken_us = triggered_us;
    if (sensor->overtaken)
        sensor->due_us = triggered_us;
}

void sensor_await(struct sensor *sensor, uint64_t triggered_us)
{
    sensor->awaiting = true;
    sensor->confirmed = sensor->overtaken = sensor->fresh = false;
    sensor->conversion.ended_us = triggered_us + SINGLE_CONVERSION_US;
    sensor->due_us = triggered_us + SINGLE_WAIT_US;
}

bool sensor_is_running(const struct sensor *sensor)
{
    return sensor->phase == PHASE_RUN || sensor->phase == PHASE_CHORE;
}

bool sensor_is_valid(const struct sensor *sensor, enum trigger trigger, uint64_t now_us)
{
    if (sensor->state != SENSOR_OK || !sensor->has_sample)
        return false;
    return trigger == TRIGGER_SIMULTANEOUS ? sensor->fresh : now_us < sensor->conversion.ended_us + STALE_US;
}

static struct hmc5983_config config_of(const struct sensor_link *link)
{
    return (struct hmc5983_config){
        .gain_code = link->gain_code,
        .bias = HMC5983_BIAS_NONE,
        .mode = link->trigger == TRIGGER_FREE ? HMC5983_CONTINUOUS : HMC5983_IDLE,
    };
}

static void schedule_next(struct sensor *sensor, const struct sensor_link *link, uint64_t now_us)
{
    if (sensor->phase == PHASE_CHORE)
        sensor->due_us = now_us;
    else if (link->trigger == TRIGGER_FREE)
        sensor->due_us = conversion_next_poll_us(&sensor->conversion);
    else if (sensor->awaiting)
        sensor->due_us = now_us;
    else
        sensor->due_us = NEVER;
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

// Also empties the output registers: what they hold was converted before, and reading all six undoes a LOCK.
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
    // Two periods until the first measurement (data sheet, mode register), and that one still has the old gain.
    sensor->settled_us = now_us + CONVERSION_PERIOD_US * 5 / 2;
    schedule_next(sensor, link, now_us);
    return BUS_OK;
}

static void seen_ready(struct sensor *sensor)
{
    sensor->missed = 0;
    sensor->suspect = false;
}

static void not_ready(struct sensor *sensor, const struct sensor_link *link, uint64_t now_us)
{
    if (link->trigger == TRIGGER_FREE && now_us > sensor->due_us + SILENCE_US)
        sensor->conversion.ended_us = now_us; // nobody looked for so long: that is not the sensor's silence
    sensor->conversion.not_ready_us = now_us;
    sensor->unchanged = 0;
    sensor->due_us = now_us + POLL_PAUSE_US;
    if (link->trigger == TRIGGER_FREE) {
        if (now_us > sensor->conversion.ended_us + SILENCE_US)
            sensor_fail(sensor, SENSOR_NO_NEW_DATA, now_us);
        return;
    }
    sensor->suspect = true;
    if (now_us > sensor->conversion.ended_us + SINGLE_WAIT_US - SINGLE_CONVERSION_US + LATE_CONVERSION_US) {
        sensor->awaiting = false;
        schedule_next(sensor, link, now_us);
        if (++sensor->missed >= MISSED_MAX)
            sensor_fail(sensor, SENSOR_NO_NEW_DATA, now_us);
    }
}

// The data sheet is not clear whether reading clears READY in continuous mode, or only the next conversion does. On chips
// of the second kind (`probe_ready` finds out) READY says little, and equal bytes are the old sample again.
static bool is_new(struct sensor *sensor, const int16_t counts[3], uint64_t seen_us)
{
    if (sensor->ready_survives < READY_SURVIVES || memcmp(counts, sensor->counts, sizeof sensor->counts) != 0) {
        sensor->unchanged = 0;
        return true;
    }
    if (seen_us < sensor->conversion.ended_us + sensor->conversion.period_us * 17U / 16U)
        return false;
    // Two equal samples do happen; many, with READY never clear, are a dead clock.
    if (sensor->conversion.not_ready_us < sensor->conversion.ready_us)
        sensor->unchanged++;
    return true;
}

static void accept(struct sensor *sensor, const struct sensor_link *link, const int16_t counts[3])
{
    uint64_t now_us = clock_now(link->clock);
    sensor->unaltered = memcmp(sensor->counts, counts, sizeof sensor->counts) == 0;
    memcpy(sensor->counts, counts, sizeof sensor->counts);
    sensor->awaiting = false;
    bool settled = !sensor->discard_next && sensor->conversion.ended_us >= sensor->settled_us;
    bool alive = sensor->unchanged == 0 || sensor->state == SENSOR_OK; // no dead clock comes back by itself
    if (settled && alive) {
        sensor->has_sample = sensor->fresh = true;
        sensor->state = SENSOR_OK;
        sensor->failures = 0;
    }
    sensor->discard_next = false;
    if (now_us >= sensor->chore_us) {
        sensor->chore_us = now_us + CHORE_INTERVAL_US;
        sensor->phase = PHASE_CHORE;
    }
    schedule_next(sensor, link, now_us);
}

// What is set right after the data were read survives reading. Several times in a row: once may be a new conversion.
static enum bus_result probe_ready(struct sensor *sensor, const struct sensor_link *link)
{
    uint8_t status = 0;
    enum bus_result result = hmc5983_read_status(link->bus, &status);
    if (!(status & HMC5983_READY))
        sensor->ready_survives = 0;
    else if (sensor->ready_survives < READY_SURVIVES)
        sensor->ready_survives++;
    return result;
}

enum bus_result sensor_confirm(struct sensor *sensor, const struct sensor_link *link)
{
    uint8_t status = 0;
    enum bus_result result = hmc5983_read_status(link->bus, &status);
    if (result != BUS_OK)
        return result;
    sensor->confirmed = status & HMC5983_READY;
    if (sensor->confirmed)
        seen_ready(sensor);
    else
        not_ready(sensor, link, clock_now(link->clock));
    return BUS_OK;
}

// The output registers hold the last trigger's sample until the next conversion ends, not longer. A burst that is under
// way at that moment has them locked, and the new sample is lost: so then it is asked whether there is one.
static enum bus_result read_overtaken(struct sensor *sensor, const struct sensor_link *link)
{
    uint64_t changes_us = sensor->overtaken_us + SINGLE_FASTEST_US;
    int16_t counts[3];
    bool in_time = clock_now(link->clock) + BURST_US < changes_us;
    enum bus_result result = in_time ? hmc5983_read(link->bus, counts) : BUS_OK;
    if (result != BUS_OK)
        return result;
    if (in_time && clock_now(link->clock) < changes_us) {
        accept(sensor, link, counts);
        return BUS_OK;
    }
    sensor->awaiting = false;
    sensor->suspect = true;
    return BUS_OK;
}

static enum bus_result poll(struct sensor *sensor, const struct sensor_link *link)
{
    uint8_t status = 0;
    int16_t counts[3];
    if (sensor->overtaken)
        return read_overtaken(sensor, link);
    enum bus_result result = hmc5983_read_status(link->bus, &status);
    uint64_t seen_us = clock_now(link->clock);
    if (result != BUS_OK)
        return result;
    bool ready = status & HMC5983_READY;
    if (ready)
        seen_ready(sensor);
    else
        not_ready(sensor, link, seen_us);
    if (!ready && !(status & HMC5983_LOCKED))
        return BUS_OK;
    result = hmc5983_read(link->bus, counts); // where only LOCK is set, to undo it
    if (result != BUS_OK || !ready)
        return result;
    if (link->trigger == TRIGGER_FREE) {
        if (!is_new(sensor, counts, seen_us)) {
            sensor->due_us = seen_us + POLL_PAUSE_US;
            return BUS_OK;
        }
        conversion_seen(&sensor->conversion, seen_us);
    }
    accept(sensor, link, counts);
    if (sensor->unchanged >= UNCHANGED_MAX)
        sensor_fail(sensor, SENSOR_NO_NEW_DATA, seen_us);
    return sensor->phase == PHASE_CHORE ? probe_ready(sensor, link) : BUS_OK;
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
    schedule_next(sensor, link, now_us);
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
        [PHASE_RUN] = poll,
        [PHASE_CHORE] = do_chore,
    };
    enum bus_result result = turns[sensor->phase](sensor, link);
    if (result == BUS_OK)
        sensor->strikes = 0;
    return result;
}
